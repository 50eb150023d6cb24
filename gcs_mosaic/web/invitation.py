"""How somebody else gets to see the page: its addresses on the network, with the token, and as a code to scan."""

from __future__ import annotations

import io
import ipaddress
import logging
import socket
from collections.abc import Iterator
from dataclasses import dataclass

from gcs_mosaic.web.address import HttpAddress, is_number, url_of
from gcs_mosaic.web.token import Access

logger = logging.getLogger(__name__)

MOST = 4  # addresses shown
FAR = ("192.0.2.1", 9)  # nothing is sent there; it lies beyond every router


@dataclass(frozen=True, slots=True, kw_only=True)
class Invitation:
    """`pages`: the page's URLs for others, the most likely first."""

    pages: tuple[str, ...]
    access: Access

    @property
    def notice(self) -> str:
        """What anybody may read, in the log and on the page."""
        if not self.pages:
            return "others cannot look at the map yet: this machine is on no network"
        where = " or ".join(self.pages)
        if self.access.is_open:
            return f"everybody on the network can look at {where}: the settings ask for no token (web: {{open: true}})"
        return f"others on the network can look at {where} with the link on the terminal"

    @property
    def links(self) -> tuple[str, ...]:
        """What lets others in."""
        if self.access.is_open:
            return self.pages
        return tuple(f"{page}?token={self.access.token}" for page in self.pages)


def invitation(address: HttpAddress, port: int, access: Access, *, secure: bool) -> Invitation | None:
    """None if nobody else can reach the page."""
    if address.is_loopback:
        return None
    hosts = list(own_addresses(address.host)) if address.is_wildcard else [address.host]
    return Invitation(pages=tuple(url_of(host, port, secure=secure) for host in hosts[:MOST]), access=access)


def own_addresses(wildcard: str) -> Iterator[str]:
    """This machine's addresses on its networks, of the wildcard's family; that of the way out of here first."""
    import ifaddr  # needs a C library's function that not every system has

    version = ipaddress.ip_address(wildcard).version
    found = [str(ip.ip[0] if isinstance(ip.ip, tuple) else ip.ip) for card in ifaddr.get_adapters() for ip in card.ips]
    usable = [text for text in found if is_number(text) and is_reachable(ipaddress.ip_address(text), version)]
    out = way_out()
    yield from sorted(dict.fromkeys(usable), key=lambda text: text != out)


def is_reachable(ip: ipaddress.IPv4Address | ipaddress.IPv6Address, version: int) -> bool:
    return ip.version == version and not (ip.is_loopback or ip.is_link_local)


def way_out() -> str:
    """The address of this machine that packets to far away would bear; "" without a way there."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(FAR)
        except OSError as error:
            logger.debug("no way out of here (%s)", error)
            return ""
        return str(probe.getsockname()[0])


def scannable(link: str) -> str:
    """A link as a QR code of block characters, to be shown light on dark."""
    import segno  # only where it is shown

    drawn = io.StringIO()
    segno.make(link, error="l", micro=False).terminal(drawn, border=2, compact=True)
    return drawn.getvalue()
