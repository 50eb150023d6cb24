"""The page's address: `--http HOST:PORT`."""

from __future__ import annotations

import ipaddress
import socket
from collections.abc import Collection
from dataclasses import dataclass
from typing import Self
from urllib.parse import urlsplit

from gcs_mosaic.errors import UsageError

LOOPBACK_NAMES = ("localhost", "127.0.0.1", "::1")
DEFAULT = "127.0.0.1:8470"


@dataclass(frozen=True, slots=True)
class HttpAddress:
    """A host name or IP address, and a port; port 0 lets the system choose one."""

    host: str
    port: int

    @classmethod
    def parse(cls, text: str) -> Self:
        """From HOST:PORT, [IPV6]:PORT or PORT. Raises UsageError."""
        split = split_host(text if ":" in text else f"127.0.0.1:{text}")
        if split is None or split[1] is None:
            raise UsageError(f"--http {text!r} is not HOST:PORT: write, for example, --http {DEFAULT}")
        return cls(split[0], split[1])

    @property
    def is_wildcard(self) -> bool:
        """Whether it is the wildcard address (0.0.0.0 or ::)."""
        return is_number(self.host) and ipaddress.ip_address(self.host).is_unspecified

    @property
    def is_loopback(self) -> bool:
        """Whether only this machine can reach it."""
        return self.host in LOOPBACK_NAMES or (is_number(self.host) and ipaddress.ip_address(self.host).is_loopback)

    def url(self, port: int, *, secure: bool = False) -> str:
        """URL for a browser on this machine; `port` is the one actually bound."""
        return url_of("127.0.0.1" if self.is_wildcard else self.host, port, secure=secure)

    def is_ours(self, host_header: str, names: Collection[str] = ()) -> bool:
        """Whether a request with this Host header is meant for this server; `names`: of this machine on its network.

        A malicious web page can resolve its own host name to this machine (DNS rebinding) and then read what we serve; its
        host name gives it away. On the wildcard address any IP address is accepted, because it cannot be rebound.
        """
        split = split_host(host_header)
        if split is None:
            return False
        host = split[0]
        if host in LOOPBACK_NAMES or host == self.host.lower():
            return True
        return not self.is_loopback and (host in names or (self.is_wildcard and is_number(host)))


def url_of(host: str, port: int, *, secure: bool = False) -> str:
    scheme = "https" if secure else "http"
    return f"{scheme}://[{host}]:{port}/" if ":" in host else f"{scheme}://{host}:{port}/"


def own_names() -> frozenset[str]:
    """The names that this machine gives itself, without asking anybody."""
    name = socket.gethostname().lower().removesuffix(".local")
    return frozenset({name, f"{name}.local"} - {"", ".local"})


def network_names() -> frozenset[str]:
    """Those under which the network knows it; a name server may be asked, which takes seconds if none answers."""
    return own_names() | {socket.getfqdn().lower()}


def is_local_name(host: str) -> bool:
    """Whether the host of a URL (lower case) is a name that no other machine on the network can claim."""
    return host in LOOPBACK_NAMES or is_number(host) or host in own_names()


def split_host(text: str) -> tuple[str, int | None] | None:
    """Host (lower case) and port of HOST, HOST:PORT or [IPV6]:PORT; None if it is neither."""
    try:
        parts = urlsplit(f"//{text}")
        whole = parts.netloc == text and "@" not in text and parts.hostname
        return (str(parts.hostname), parts.port) if whole else None
    except ValueError:
        return None


def is_number(host: str) -> bool:
    """Whether the host is an IP address."""
    try:
        ipaddress.ip_address(host)
    except ValueError:
        return False
    return True
