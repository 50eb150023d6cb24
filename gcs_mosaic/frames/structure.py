"""Parsing the structure of a file that may be truncated anywhere."""

from __future__ import annotations

import struct
from dataclasses import dataclass


class StructureError(Exception):
    """The file is truncated or malformed; the message says where. Never leaves this package."""


@dataclass(frozen=True, slots=True)
class Whole:
    """A complete image of `width` x `height` pixels, as stored (no orientation applied); transparency is not a band."""

    width: int
    height: int
    bands: int = 3
    bits: int = 8  # per band


def unpack(form: str, data: bytes, offset: int) -> tuple[int, ...]:
    """Like `struct.unpack_from`; raises StructureError if out of bounds."""
    if offset < 0 or offset + struct.calcsize(form) > len(data):
        raise StructureError(f"truncated: it ends after {len(data)} bytes")
    return struct.unpack_from(form, data, offset)
