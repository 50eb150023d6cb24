"""Parsing `--rtsp` and displaying stream addresses: possible passwords are never shown."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from ipaddress import IPv4Network, IPv6Network, ip_address, ip_network
from urllib.parse import urlsplit

from gcs_mosaic.errors import UsageError

AUTO = "auto"
"""Used instead of an address: the aircraft announces its stream."""

_HARMLESS_PATH = re.compile(r"[/\w.-]{0,80}", re.ASCII)  # others contain passwords: /user=admin_password=1234_channel=1
_HOST = re.compile(r"[A-Za-z0-9]([A-Za-z0-9.-]{0,251}[A-Za-z0-9])?")


@dataclass(frozen=True, slots=True)
class StreamAddress:
    """A stream address. `url` may contain a password and is only for connecting; `shown` is for display."""

    url: str = field(repr=False)
    host: str
    shown: str


def parse_stream(text: str) -> StreamAddress:
    """Parse an rtsp:// or rtsps:// address. Raises UsageError, which does not quote it."""
    try:
        parts = urlsplit(text.strip())
        port = f":{parts.port}" if parts.port else ""
    except ValueError:
        raise _malformed() from None
    host = parts.hostname or ""
    if parts.scheme not in ("rtsp", "rtsps") or not text.isprintable() or " " in text.strip() or not _is_host(host):
        raise _malformed()
    shown_host = f"[{host}]" if ":" in host else host
    path = parts.path if _HARMLESS_PATH.fullmatch(parts.path) else "/…"
    return StreamAddress(text.strip(), host, f"{parts.scheme}://{shown_host}{port}{path}")


def check_allowed(hosts: Iterable[str]) -> None:
    """Raises UsageError if an allow-list entry is neither a host nor a network, or if the list is empty."""
    hosts = list(hosts)
    for word in hosts:
        if not _is_host(word) and _network(word) is None:
            raise UsageError(
                f"stream: allowed_hosts: {word!r} is not understood: give hosts or networks, such as 192.168.1.0/24."
            )
    if not hosts:
        raise UsageError(
            "--rtsp auto takes the camera's address from the link, where anybody may send one: name the hosts that are "
            "allowed in the settings, such as stream: {allowed_hosts: [192.168.1.0/24]}, or give --rtsp the address."
        )


def is_allowed(host: str, hosts: Iterable[str]) -> bool:
    """Whether the list contains the host or a network it is in; names are compared, never resolved."""
    for word in hosts:
        network = _network(word)
        if word.lower() == host.lower():
            return True
        if network is not None and _is_address(host) and ip_address(host) in network:
            return True
    return False


def _is_host(host: str) -> bool:
    return _HOST.fullmatch(host) is not None or _is_address(host)


def _is_address(host: str) -> bool:
    try:
        return bool(ip_address(host))
    except ValueError:
        return False


def _network(word: str) -> IPv4Network | IPv6Network | None:
    try:
        return ip_network(word)
    except ValueError:
        return None


def _malformed() -> UsageError:
    return UsageError(
        "--rtsp: the address is not understood (it is not shown, because it may hold a password): "
        "give one such as rtsp://192.168.1.20:554/main or rtsp://USER:PASSWORD@192.168.1.20/main."
    )
