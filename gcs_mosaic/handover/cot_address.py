"""Whom finds are sent to as Cursor on Target; a module of its own, so that settings are read without what makes events."""

from __future__ import annotations

import re
from dataclasses import dataclass

from gcs_mosaic.errors import UsageError

ADDRESS = re.compile(r"(udp|tcp):(?://)?(\[[0-9a-fA-F:.]+\]|[A-Za-z0-9.-]{1,253}):([0-9]{1,5})")


@dataclass(frozen=True, slots=True)
class CotAddress:
    """Whom events are sent to: `udp` (also a multicast group) or `tcp`."""

    kind: str
    host: str
    port: int


def cot_address(text: str) -> CotAddress:
    """Of `udp:239.2.3.1:6969` or `tcp:HOST:8087`. Raises UsageError."""
    found = ADDRESS.fullmatch(text.strip())
    if found is None or not 1 <= int(found[3]) <= 65535:
        raise UsageError(f"{text!r} came where an address such as udp:239.2.3.1:6969 or tcp:HOST:8087 is wanted")
    return CotAddress(found[1], found[2].strip("[]"), int(found[3]))
