"""Where a camera redirects us to, asked before FFmpeg connects: FFmpeg follows every redirect, and cannot be told not to, and
takes a description of any length.

One DESCRIBE over a connection of our own. Whoever answers FFmpeg otherwise than us is found by FFmpeg's log, and left at once.
"""

from __future__ import annotations

import logging
import re
import socket
import ssl
import time
from collections.abc import Iterable
from dataclasses import dataclass
from urllib.parse import urlsplit

from gcs_mosaic.errors import UsageError
from gcs_mosaic.frames.rtsp.address import StreamAddress, is_allowed, parse_stream

logger = logging.getLogger(__name__)

MOST_REDIRECTS = 3
_PORTS = {"rtsp": 554, "rtsps": 322}
_LONGEST_ANSWER = 8192  # bytes of a response's head
_STATUS = re.compile(rb"RTSP/\d\.\d (\d{3})")
_LOCATION = re.compile(rb"^location:[ \t]*(\S+)", re.IGNORECASE | re.MULTILINE)
_LENGTH = re.compile(rb"^content-length:[ \t]*(\d{1,18})", re.IGNORECASE | re.MULTILINE)
MOST_DESCRIBED = 1 << 20  # bytes of an SDP: FFmpeg takes 2 GB into memory, if a camera announces them
_FOLLOWED = re.compile(r"[Rr]edirecting to (\S+)")


def final_address(address: StreamAddress, allowed: Iterable[str], timeout_s: float) -> StreamAddress | str:
    """The address to connect to: `address`, or where it redirects to if that host is its own or allowed; else the reason.

    A camera that does not answer redirects nowhere: connecting will tell.
    """
    allowed = [address.host, *allowed]
    deadline = time.monotonic() + timeout_s
    for _ in range(MOST_REDIRECTS + 1):
        answer = _answer(address, deadline)
        if answer.described_bytes > MOST_DESCRIBED:
            return f"it announces a description of {answer.described_bytes} bytes, and streams have some hundred"
        if answer.location is None:
            return address
        try:
            target = parse_stream(answer.location)
        except UsageError:
            return "it redirects to an address that is not understood"
        if not is_allowed(target.host, allowed):
            return refusal(target)
        address = _with_login_of(address, target)
    return f"it redirects more than {MOST_REDIRECTS} times"


def refusal(target: StreamAddress) -> str:
    """Why a redirect is not followed."""
    return f"it redirects to the host {target.host}, which is not in stream: allowed_hosts"


def followed_elsewhere(texts: Iterable[str], address: StreamAddress, allowed: Iterable[str]) -> str | None:
    """Why to leave a connection, if FFmpeg's log tells that it followed a redirect to a host that is not allowed."""
    allowed = [address.host, *allowed]
    for text in texts:
        if found := _FOLLOWED.search(text):
            try:
                target = parse_stream(found[1])
            except UsageError:
                return "it redirects to an address that is not understood"
            if not is_allowed(target.host, allowed):
                return refusal(target)
    return None


def _with_login_of(address: StreamAddress, target: StreamAddress) -> StreamAddress:
    """The target with the name and password of the address, if it is the same host and has none of its own."""
    login, at, _ = urlsplit(address.url).netloc.rpartition("@")
    parts = urlsplit(target.url)
    if not at or target.host.lower() != address.host.lower() or "@" in parts.netloc:
        return target
    return parse_stream(parts._replace(netloc=f"{login}@{parts.netloc}").geturl())


@dataclass(frozen=True, slots=True)
class _Answer:
    """To one DESCRIBE: where it is redirected to, and the length of the description that is announced."""

    location: str | None = None
    described_bytes: int = 0


def _answer(address: StreamAddress, deadline: float) -> _Answer:
    parts = urlsplit(address.url)
    try:
        where = (address.host, parts.port or _PORTS[parts.scheme])
        with socket.create_connection(where, timeout=max(0.1, deadline - time.monotonic())) as plain:
            if parts.scheme == "rtsp":
                head = _asked(plain, parts.geturl(), address.host, deadline)
            else:
                with _encrypted(plain, address.host) as connection:
                    head = _asked(connection, parts.geturl(), address.host, deadline)
    except (OSError, ValueError):
        logger.debug("the camera does not tell whether it redirects", exc_info=True)
        return _Answer()
    status, location, length = _STATUS.match(head), _LOCATION.search(head), _LENGTH.search(head)
    described = int(length[1]) if length else 0
    if status is None or location is None or not status[1].startswith(b"3"):
        return _Answer(None, described)
    return _Answer(location[1].decode("latin-1"), described)


def _encrypted(plain: socket.socket, host: str) -> ssl.SSLSocket:
    """As FFmpeg does, without a check of the certificate: cameras sign their own."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    return context.wrap_socket(plain, server_hostname=host)


def _asked(connection: socket.socket, url: str, host: str, deadline: float) -> bytes:
    """The head of the answer to a DESCRIBE, without a password in it."""
    parts = urlsplit(url)
    port = f":{parts.port}" if parts.port else ""
    shown_host = f"[{host}]" if ":" in host else host
    plain_url = parts._replace(netloc=f"{shown_host}{port}").geturl()
    request = f"DESCRIBE {plain_url} RTSP/1.0\r\nCSeq: 1\r\nAccept: application/sdp\r\n\r\n"
    connection.settimeout(max(0.1, deadline - time.monotonic()))
    connection.sendall(request.encode("ascii", "replace"))
    head = b""
    while b"\r\n\r\n" not in head and len(head) < _LONGEST_ANSWER:
        connection.settimeout(max(0.1, deadline - time.monotonic()))
        data = connection.recv(_LONGEST_ANSWER)
        if not data or time.monotonic() > deadline:
            break
        head += data
    return head
