"""Reading the structure of a file that may end anywhere."""

from __future__ import annotations

import struct


class StructureError(Exception):
    """The file ends, or breaks its own rules, before it should; the message says where. Never leaves this room."""


def unpack(form: str, data: bytes, offset: int) -> tuple[int, ...]:
    """Like `struct.unpack_from`; raises StructureError beyond either end."""
    if offset < 0 or offset + struct.calcsize(form) > len(data):
        raise StructureError(f"truncated: it ends after {len(data)} bytes")
    return struct.unpack_from(form, data, offset)
