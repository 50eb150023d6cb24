"""Drains a UDP socket without releasing the GIL between datagrams.

Each Python socket call releases the GIL and waits up to 5 ms to reacquire it while another thread computes, which limits
reception to 200 datagrams a second. The C library's `recvfrom` is therefore called with the GIL held, non-blocking.
"""

from __future__ import annotations

import ctypes
import errno
import os
import select
import socket
import time
from collections.abc import Iterator
from typing import NamedTuple

_LARGEST = 65535  # bytes of a datagram
_MOST = 256  # datagrams per batch, so that the stop flag is checked in between


class Datagram(NamedTuple):
    """One datagram, its sender (host, port), and when it was read (monotonic seconds)."""

    data: bytes
    sender: tuple[str, int]
    received: float


class _Address(ctypes.Structure):
    """`sockaddr_in`; the first two bytes are not interpreted, because they differ between systems."""

    _fields_ = (
        ("family", ctypes.c_uint16),
        ("port", ctypes.c_uint16),
        ("host", ctypes.c_ubyte * 4),
        ("zero", ctypes.c_uint64),
    )


class DatagramReader:
    """Reads a bound socket. IPv6 uses the slower Python path: no telemetry radio floods us over it."""

    def __init__(self, bound: socket.socket) -> None:
        self._socket = bound
        bound.setblocking(False)
        self._library = _c_library() if bound.family == socket.AF_INET else None
        self._buffer = bytearray(_LARGEST)
        self._place = (ctypes.c_char * _LARGEST).from_buffer(self._buffer)
        self._address = _Address()

    def read(self, timeout_s: float) -> list[Datagram]:
        """The pending datagrams, oldest first; empty after `timeout_s` without any."""
        found = list(self._taken())
        if not found and select.select([self._socket], [], [], timeout_s)[0]:
            found = list(self._taken())
        return found

    def _taken(self) -> Iterator[Datagram]:
        for _ in range(_MOST):
            taken = self._take_by_library(self._library) if self._library else self._take()
            if taken is None:
                return
            yield Datagram(*taken, time.monotonic())

    def _take_by_library(self, library: ctypes.PyDLL) -> tuple[bytes, tuple[str, int]] | None:
        length = ctypes.c_uint32(ctypes.sizeof(_Address))
        where = (self._place, _LARGEST, socket.MSG_DONTWAIT, ctypes.byref(self._address), ctypes.byref(length))
        size = library.recvfrom(self._socket.fileno(), *where)
        if size < 0:
            if ctypes.get_errno() in (errno.EAGAIN, errno.EINTR, errno.ECONNREFUSED):
                return None
            raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))
        sender = ".".join(map(str, self._address.host)), socket.ntohs(self._address.port)
        return bytes(self._buffer[:size]), sender

    def _take(self) -> tuple[bytes, tuple[str, int]] | None:
        try:
            data, sender = self._socket.recvfrom(_LARGEST)
        except (BlockingIOError, ConnectionError):  # Windows reports a peer's closed port here
            return None
        return data, (sender[0], sender[1])


def _c_library() -> ctypes.PyDLL | None:
    """The C library with a non-blocking `recvfrom`; None where unavailable, as on Windows."""
    if not hasattr(socket, "MSG_DONTWAIT"):
        return None
    try:
        library = ctypes.PyDLL(None, use_errno=True)
    except TypeError:  # Windows
        return None
    return library if hasattr(library, "recvfrom") else None
