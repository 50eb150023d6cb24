"""Reading the structure of a file that may end anywhere."""

from __future__ import annotations

import struct
from dataclasses import dataclass


class StructureError(Exception):
    """The file ends, or breaks its own rules, before it should; the message says where. Never leaves this room."""


@dataclass(frozen=True, slots=True)
class Whole:
    """A complete image of `width` x `height` pixels, as it is stored (no orientation applied); transparency is no band."""

    width: int
    height: int
    bands: int = 3
    bits: int = 8  # of a band


def unpack(form: str, data: bytes, offset: int) -> tuple[int, ...]:
    """Like `struct.unpack_from`; raises StructureError beyond either end."""
    if offset < 0 or offset + struct.calcsize(form) > len(data):
        raise StructureError(f"truncated: it ends after {len(data)} bytes")
    return struct.unpack_from(form, data, offset)
