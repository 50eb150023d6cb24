"""Settings of the page: who may look, and how many at a time."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Literal

from gcs_mosaic.errors import UsageError
from gcs_mosaic.handover.cot_address import cot_address


@dataclass(frozen=True, slots=True, kw_only=True)
class WebSettings:
    """Who may look at the page, and how much of the machine they may take. Times are in seconds."""

    open: bool = False  # other machines need no token
    certificate: str | None = None  # PEM file: the page is served over HTTPS
    key: str | None = None  # PEM file with its private key, unless that is in the certificate's file
    cors: bool = False  # pages of other sites may show the map on earth
    underlay: str | None = (
        None  # an MBTiles file, or a folder z/x/y.png: shown under the map where a program asks for it
    )
    cot: str | None = None  # where finds are sent on wish as Cursor on Target: udp:239.2.3.1:6969 is ATAK's own group
    qr: Literal["auto", "always", "never"] = "auto"  # the link for others as a QR code; auto: on a terminal
    connections: int = 200  # at a time; each takes two files at most, and 1,024 is the usual limit
    # ... of one address: four pages in browsers. As many are kept for this machine itself.
    connections_per_address: int = 32
    pages: int = 64  # listening for changes at a time; further ones ask every two seconds
    pages_per_address: int = 16
    request_s: float = 10.0  # until a request must have come as a whole, and longest silence between two
    answer_s: float = 60.0  # until an answer must have been taken: some MB over a bad network

    def __post_init__(self) -> None:
        if self.key and not self.certificate:
            raise ValueError("key: expected a certificate with it, got a key alone")
        if self.cot is not None:
            try:
                cot_address(self.cot)
            except UsageError as error:
                raise ValueError(f"cot: {error}") from error
        for field in fields(self):
            value = getattr(self, field.name)
            if not isinstance(value, bool) and isinstance(value, int | float) and value <= 0:
                raise ValueError(f"{field.name}: expected more than 0, got {value:g}")
        if self.connections_per_address >= self.connections:
            raise ValueError(f"connections: expected more than connections_per_address, got {self.connections}")
