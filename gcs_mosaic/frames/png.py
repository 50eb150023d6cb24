"""PNG: verifies every chunk and its checksum, to the last. Source: ISO/IEC 15948, clause 5."""

from __future__ import annotations

import zlib

from gcs_mosaic.frames.structure import StructureError, Whole, unpack

_SIGNATURE = 8
_GREY = (0, 4)  # colour types, without and with transparency
_FRAME = 12  # length, type and checksum around a chunk's data
MOST_CHUNKS = 500_000  # a picture of 1 GB in chunks of 4 kB has half as many


def png_header(data: bytes) -> Whole:
    """Size and bands; raises StructureError if a chunk is truncated or corrupt, or if the end is missing."""
    position, whole, kinds = _SIGNATURE, Whole(0, 0), set[bytes]()
    view, chunks = memoryview(data), 0
    while b"IEND" not in kinds:
        chunks += 1
        if chunks > MOST_CHUNKS:
            raise StructureError(f"damaged: a PNG of more than {MOST_CHUNKS} chunks")
        (length,) = unpack(">I", data, position)
        (checksum,) = unpack(">I", data, position + 8 + length)
        if zlib.crc32(view[position + 4 : position + 8 + length]) != checksum:
            raise StructureError(f"damaged: a PNG chunk with a wrong checksum at byte {position}")
        kind = data[position + 4 : position + 8]
        if kind == b"IHDR":
            width, height, bits, colours = unpack(">IIBB", data, position + 8)
            whole = Whole(width, height, 1 if colours in _GREY else 3, 16 if bits == 16 else 8)
        kinds.add(kind)
        position += _FRAME + length
    if not {b"IHDR", b"IDAT"} <= kinds:
        raise StructureError("damaged: a PNG without a picture")
    return whole
