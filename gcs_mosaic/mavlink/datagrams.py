"""All datagrams that have come to a UDP socket, without letting other threads in between one and the next.

Python gives up its lock with every call of a socket and waits up to 5 ms to have it back while another thread computes: 200
datagrams a second. So they are taken by the C library's own `recvfrom`, called with the lock held; it never waits.
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
_MOST = 256  # datagrams at a time: then somebody looks whether to stop


class Datagram(NamedTuple):
    """What one sender (host, port) sent at once, and when it was taken (monotonic seconds)."""

    data: bytes
    sender: tuple[str, int]
    received: float


class _Address(ctypes.Structure):
    """`sockaddr_in`; its first two bytes are not looked at, because they differ between systems."""

    _fields_ = (
        ("family", ctypes.c_uint16),
        ("port", ctypes.c_uint16),
        ("host", ctypes.c_ubyte * 4),
        ("zero", ctypes.c_uint64),
    )


class DatagramReader:
    """Reads a bound socket. IPv6 goes the slower way: no radio floods us over it."""

    def __init__(self, bound: socket.socket) -> None:
        self._socket = bound
        bound.setblocking(False)
        self._library = _c_library() if bound.family == socket.AF_INET else None
        self._buffer = bytearray(_LARGEST)
        self._place = (ctypes.c_char * _LARGEST).from_buffer(self._buffer)
        self._address = _Address()

    def read(self, timeout_s: float) -> list[Datagram]:
        """What has come, oldest first; empty if nothing comes for so long."""
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
        except (BlockingIOError, ConnectionError):  # Windows reports another's closed port here
            return None
        return data, (sender[0], sender[1])


def _c_library() -> ctypes.PyDLL | None:
    """The C library whose `recvfrom` never waits; None where there is none to be had, as on Windows."""
    if not hasattr(socket, "MSG_DONTWAIT"):
        return None
    try:
        library = ctypes.PyDLL(None, use_errno=True)
    except TypeError:  # Windows
        return None
    return library if hasattr(library, "recvfrom") else None
