"""Exclusive sockets, or the reason why a port cannot be bound.

pymavlink binds with SO_REUSEADDR, which lets a second listener bind without an error and take the first one's packets.
These sockets are exclusive, so the kernel itself reports, without a race, that the port is in use.
"""

from __future__ import annotations

import errno
import socket
from collections.abc import Iterator
from pathlib import Path

from gcs_mosaic.errors import UsageError
from gcs_mosaic.mavlink.address import host_and_port

_SHARING = (
    "close it, or let it forward to another port and listen there (QGroundControl: Application Settings > MAVLink > "
    "Enable forwarding, then --mavlink udp:14445; mavproxy --out=udpout:127.0.0.1:14445; mavlink-router)"
)


def bind_udp(host: str, port: int, receive_buffer: int) -> socket.socket:
    """A datagram socket bound exclusively to (host, port). Raises UsageError if that fails."""
    return _bind(socket.SOCK_DGRAM, host, port, receive_buffer)


def listen_tcp(host: str, port: int, receive_buffer: int) -> socket.socket:
    """A stream socket listening on (host, port). Raises UsageError if that fails."""
    listener = _bind(socket.SOCK_STREAM, host, port, receive_buffer)
    listener.listen(1)
    return listener


def family_of(host: str) -> socket.AddressFamily:
    """Host names resolve to IPv4, the default of radios and ground stations."""
    return socket.AF_INET6 if ":" in host else socket.AF_INET


def holder_of_udp_port(port: int) -> str | None:
    """Name and process id of the program that holds the UDP port, where visible (Linux)."""
    inodes = set(_inodes_on(port))
    for descriptor in Path("/proc").glob("[0-9]*/fd/*") if inodes else ():
        try:
            if str(descriptor.readlink()) in inodes:
                process = descriptor.parent.parent
                return f"{(process / 'comm').read_text().strip()} (process {process.name})"
        except OSError:  # the process has ended, or belongs to another user
            continue
    return None


def _bind(kind: socket.SocketKind, host: str, port: int, receive_buffer: int) -> socket.socket:
    bound = socket.socket(family_of(host), kind)
    try:
        if hasattr(socket, "SO_EXCLUSIVEADDRUSE"):  # Windows shares a port by default
            bound.setsockopt(socket.SOL_SOCKET, socket.SO_EXCLUSIVEADDRUSE, 1)
        elif kind == socket.SOCK_STREAM:
            # For TCP this only ignores connections in TIME_WAIT; it never shares a listener.
            bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_buffer)
        bound.bind((host, port))
    except OSError as error:
        bound.close()
        raise _refusal(host, port, kind, error) from error
    return bound


def _refusal(host: str, port: int, kind: socket.SocketKind, error: OSError) -> UsageError:
    name = f"{'UDP' if kind == socket.SOCK_DGRAM else 'TCP'} port {port}"
    if error.errno == errno.EADDRINUSE:
        holder = (holder_of_udp_port(port) if kind == socket.SOCK_DGRAM else None) or "another program"
        return UsageError(f"{name} is taken by {holder}: {_SHARING}.")
    if error.errno == errno.EACCES:
        return UsageError(f"{name} is reserved for the system: use one from 1024 up, such as udp:14550.")
    return UsageError(
        f"{host_and_port(host, port)} cannot be listened on ({error.strerror or error}): give an address of this machine, "
        f"or leave it out, as in udp:{port}."
    )


def _inodes_on(port: int) -> Iterator[str]:
    for table in ("udp", "udp6"):
        try:
            rows = Path(f"/proc/net/{table}").read_text().splitlines()[1:]
        except OSError:
            continue
        for columns in map(str.split, rows):
            if int(columns[1].rpartition(":")[2], 16) == port:
                yield f"socket:[{columns[9]}]"
