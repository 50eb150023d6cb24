"""Whether bytes begin as a tile or a mask of ours does, before anything is decoded: a small file may claim a gigapixel."""

from __future__ import annotations

import struct

from gcs_mosaic.render.tile_grid import TILE_SIZE

PNG = b"\x89PNG\r\n\x1a\n"
JPEG = b"\xff\xd8"
SIZE_MARKERS = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}  # SOFn of ITU-T T.81, annex B, which contain the size


def is_tile_sized(data: bytes) -> bool:
    """Whether this is a JPEG or PNG of a tile's size by its header."""
    try:
        size = _png_size(data) if data.startswith(PNG) else _jpeg_size(data) if data.startswith(JPEG) else None
    except (struct.error, IndexError):
        return False
    return size == (TILE_SIZE, TILE_SIZE)


def _png_size(data: bytes) -> tuple[int, int]:
    """(width, height)."""
    width, height = struct.unpack_from(">II", data, 16)
    return width, height


def _jpeg_size(data: bytes) -> tuple[int, int] | None:
    """(width, height); None for what is not written by an encoder of ours."""
    position = 2
    while data[position] == 0xFF:
        marker, length = data[position + 1], struct.unpack_from(">H", data, position + 2)[0]
        if marker in SIZE_MARKERS:
            height, width = struct.unpack_from(">HH", data, position + 5)
            return width, height
        position += 2 + max(length, 2)
    return None
