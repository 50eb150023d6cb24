"""Drains a UDP socket without releasing the GIL between datagrams, with the kernel's receive times where it tells them.

Each Python socket call releases the GIL and waits up to 5 ms to reacquire it while another thread computes, which limits
reception to 200 datagrams a second. The C library's `recvmsg` is therefore called with the GIL held, non-blocking.
"""

from __future__ import annotations

import ctypes
import errno
import os
import select
import socket
import struct
import sys
import time
from collections.abc import Iterator
from typing import NamedTuple

from gcs_mosaic.mavlink.arrival_clock import ArrivalClock

_LARGEST = 65535  # bytes of a datagram
_MOST = 256  # datagrams per batch, so that the stop flag is checked in between
_CONTROL = 128  # bytes of ancillary data; a receive time takes 32
# Linux's SO_TIMESTAMPNS, which Python does not name: since Linux 5.1 with 64-bit seconds everywhere, and before.
_STAMPS = (64, 35)
_TIMESPEC = struct.Struct("=qq")  # seconds since 1970, nanoseconds


# What a network tells of packets sent before (ICMP), or is short of for a moment: as if nothing had come (accept(2) of Linux).
PASSING = {
    getattr(errno, name)
    for name in (
        *("EAGAIN", "EINTR", "ECONNREFUSED", "ECONNRESET", "EHOSTUNREACH", "EHOSTDOWN", "ENETUNREACH", "ENETDOWN"),
        *(
            "ENONET",
            "EPROTO",
            "ENOPROTOOPT",
            "EOPNOTSUPP",
            "ENOBUFS",
            "ENOMEM",
            "EMSGSIZE",
            "ETIMEDOUT",
            "EACCES",
            "EPERM",
        ),
    )
    if hasattr(errno, name)
}


class Datagram(NamedTuple):
    """One datagram, its sender (host, port), and when it arrived (monotonic seconds)."""

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


class _Part(ctypes.Structure):
    """`iovec`."""

    _fields_ = (("base", ctypes.c_void_p), ("length", ctypes.c_size_t))


class _Header(ctypes.Structure):
    """`msghdr` of Linux."""

    _fields_ = (
        ("name", ctypes.c_void_p),
        ("name_length", ctypes.c_uint32),
        ("parts", ctypes.POINTER(_Part)),
        ("part_count", ctypes.c_size_t),
        ("control", ctypes.c_void_p),
        ("control_length", ctypes.c_size_t),
        ("flags", ctypes.c_int),
    )


class _ControlHeader(ctypes.Structure):
    """`cmsghdr` of Linux; its data follow."""

    _fields_ = (("length", ctypes.c_size_t), ("level", ctypes.c_int), ("type", ctypes.c_int))


_Taken = tuple[bytes, tuple[str, int], float | None]  # data, sender, receive time (UTC)


class DatagramReader:
    """Reads a bound or connected socket. IPv6, and systems other than Linux, use the slower Python path."""

    def __init__(self, bound: socket.socket) -> None:
        self._socket = bound
        bound.setblocking(False)
        _ask_for_stamps(bound)
        self._library = _c_library() if bound.family == socket.AF_INET else None
        self._buffer, self._control = bytearray(_LARGEST), bytearray(_CONTROL)
        self._address = _Address()
        self._part = _Part(_location(self._buffer), _LARGEST)
        self._header = _Header(
            name=ctypes.addressof(self._address),
            parts=ctypes.pointer(self._part),
            part_count=1,
            control=_location(self._control),
        )
        self._clock = ArrivalClock(time.monotonic(), time.time())

    def read(self, timeout_s: float) -> list[Datagram]:
        """The pending datagrams, oldest first; empty after `timeout_s` without any."""
        found = self._batch()
        if not found and select.select([self._socket], [], [], timeout_s)[0]:
            found = self._batch()
        return found

    def _batch(self) -> list[Datagram]:
        now = time.monotonic()
        self._clock.read_at(now, time.time())
        taken = list(self._taken())
        read_at = time.monotonic()
        found = [Datagram(data, sender, self._received(stamp, read_at)) for data, sender, stamp in taken]
        if len(taken) < _MOST:
            self._clock.emptied(now)
        return found

    def _received(self, stamp: float | None, read_at: float) -> float:
        return read_at if stamp is None else self._clock.arrived(stamp, read_at)

    def _taken(self) -> Iterator[_Taken]:
        for _ in range(_MOST):
            taken = self._take_by_library(self._library) if self._library else self._take()
            if taken is None:
                return
            yield taken

    def _take_by_library(self, library: ctypes.PyDLL) -> _Taken | None:
        self._header.name_length, self._header.control_length = ctypes.sizeof(_Address), _CONTROL
        size = library.recvmsg(self._socket.fileno(), ctypes.byref(self._header), socket.MSG_DONTWAIT)
        if size < 0:
            if ctypes.get_errno() in PASSING:
                return None
            raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))
        sender = ".".join(map(str, self._address.host)), socket.ntohs(self._address.port)
        return bytes(self._buffer[:size]), sender, self._stamp(self._header.control_length)

    def _stamp(self, length: int) -> float | None:
        """The receive time in the ancillary data, which holds nothing else."""
        if length < ctypes.sizeof(_ControlHeader):
            return None
        header = _ControlHeader.from_buffer(self._control)
        return _stamp_in(header.level, header.type, self._control[ctypes.sizeof(_ControlHeader) : header.length])

    def _take(self) -> _Taken | None:
        try:
            if not hasattr(self._socket, "recvmsg"):  # Windows
                data, sender = self._socket.recvfrom(_LARGEST)
                return data, (sender[0], sender[1]), None
            data, control, _, sender = self._socket.recvmsg(_LARGEST, _CONTROL)
        except (BlockingIOError, ConnectionError):  # Windows reports a peer's closed port here
            return None
        except OSError as error:
            if error.errno in PASSING:
                return None
            raise
        stamps = (_stamp_in(*one) for one in control)
        return data, (sender[0], sender[1]), next((stamp for stamp in stamps if stamp is not None), None)


def _ask_for_stamps(bound: socket.socket) -> None:
    """Have the kernel tell when each datagram arrived, where it can."""
    for option in _STAMPS if sys.platform == "linux" else ():
        try:
            bound.setsockopt(socket.SOL_SOCKET, option, 1)
            return
        except OSError as error:
            if error.errno != errno.ENOPROTOOPT:
                raise


def _stamp_in(level: int, kind: int, data: bytes | bytearray) -> float | None:
    """The receive time (UTC) in one piece of ancillary data, if it is one."""
    if level != socket.SOL_SOCKET or kind not in _STAMPS or len(data) != _TIMESPEC.size:
        return None
    seconds, nanoseconds = _TIMESPEC.unpack(data)
    return float(seconds + nanoseconds / 1e9)


def _location(buffer: bytearray) -> int:
    return ctypes.addressof((ctypes.c_char * len(buffer)).from_buffer(buffer))


def _c_library() -> ctypes.PyDLL | None:
    """The C library, whose `recvmsg` is called with Linux's structures; None elsewhere."""
    if sys.platform != "linux" or not hasattr(socket, "MSG_DONTWAIT"):
        return None
    try:
        library = ctypes.PyDLL(None, use_errno=True)
    except TypeError:  # Windows
        return None
    return library if hasattr(library, "recvmsg") else None
