"""PNG: verifies every chunk and its checksum, to the last. Source: ISO/IEC 15948, clause 5."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass

from gcs_mosaic.frames.structure import StructureError, Whole, image_start, unpack

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_GREY = (0, 4)  # colour types, without and with transparency
_SAMPLES = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}  # of a pixel, by colour type
_BITS = (1, 2, 4, 8, 16)
_FRAME = 12  # length, type and checksum around a chunk's data
_DRAWN = (b"PLTE", b"tRNS")  # chunks that pixels depend on, besides header and data
# Of interlaced pictures: first column and row of each pass, and the steps between them.
_PASSES = ((0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4), (1, 0, 2, 2), (0, 1, 1, 2))
MOST_CHUNKS = 500_000  # a picture of 1 GB in chunks of 4 kB has half as many
AT_ONCE = 1 << 20  # bytes unpacked


@dataclass(frozen=True, slots=True)
class _Chunk:
    """`place` is where its data begin."""

    kind: bytes
    place: int
    data: memoryview
    is_right: bool  # by its checksum
    is_cut: bool  # the file ends before it does


def png_header(data: bytes) -> Whole:
    """Size and bands; raises StructureError if header or data are missing."""
    whole, has_data, doubt = None, False, ""
    if not data.startswith(_SIGNATURE):
        doubt = "it has other bytes in front"
    for chunk in _chunks(data):
        if not chunk.is_right:
            doubt = doubt or f"a PNG chunk with a wrong checksum at byte {chunk.place}"
        if chunk.kind == b"IHDR" and whole is None:
            whole = _size(chunk.data)
        has_data |= chunk.kind == b"IDAT"
        if chunk.kind == b"IEND":
            break
    else:
        doubt = doubt or "it has no end yet"
    if whole is None or not has_data:
        raise StructureError(
            f"truncated: it ends after {len(data)} bytes" if doubt else "damaged: a PNG without a picture"
        )
    return Whole(whole.width, whole.height, whole.bands, whole.bits, doubt)


def mended_png(data: bytes) -> bytes:
    """What is needed of a PNG to show it, with checksums and end. Raises StructureError if rows are missing or damaged."""
    chunks = list(_chunks(data))
    header = next(chunk.data for chunk in chunks if chunk.kind == b"IHDR")
    pieces = [chunk for chunk in chunks if chunk.kind == b"IDAT"]
    _refuse_missing_rows(header, pieces)
    drawn = [(chunk.kind, bytes(chunk.data)) for chunk in chunks if chunk.kind in _DRAWN and chunk.is_right]
    parts = [(b"IHDR", bytes(header)), *drawn, (b"IDAT", b"".join(piece.data for piece in pieces)), (b"IEND", b"")]
    return _SIGNATURE + b"".join(
        struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))
        for kind, content in parts
    )


def _chunks(data: bytes) -> Iterator[_Chunk]:
    """Up to the end of the picture, or of the file."""
    _, start = image_start(data) or ("png", 0)
    position, view, count = start + len(_SIGNATURE), memoryview(data), 0
    while position + 8 <= len(data):
        count += 1
        if count > MOST_CHUNKS:
            raise StructureError(f"damaged: a PNG of more than {MOST_CHUNKS} chunks")
        (length,) = unpack(">I", data, position)
        kind, end = data[position + 4 : position + 8], position + 8 + length
        if not kind.isalpha():
            return
        is_cut = end + 4 > len(data)
        is_right = not is_cut and unpack(">I", data, end) == (zlib.crc32(view[position + 4 : end]),)
        yield _Chunk(kind, position + 8, view[position + 8 : end], is_right, is_cut)
        if kind == b"IEND":
            return
        position += _FRAME + length


def _size(header: memoryview) -> Whole:
    width, height, bits, colours = unpack(">IIBB", header, 0)
    return Whole(width, height, 1 if colours in _GREY else 3, 16 if bits == 16 else 8)


def _refuse_missing_rows(header: memoryview, pieces: list[_Chunk]) -> None:
    width, height, bits, colours, _, _, interlaced = unpack(">IIBBBBB", header, 0)
    if bits not in _BITS:
        raise StructureError(f"damaged: a PNG of {bits} bits")
    passes = _PASSES if interlaced else ((0, 0, 1, 1),)
    sizes = [(-(-(width - x) // across), -(-(height - y) // down)) for x, y, across, down in passes]
    pixel_bits = bits * _SAMPLES.get(colours, 1)
    wanted = sum(high * (1 + -(-wide * pixel_bits // 8)) for wide, high in sizes if wide > 0 and high > 0)
    unpacked, is_proven = _unpacked(pieces, wanted)
    wrong = next((piece for piece in pieces if not piece.is_right and not piece.is_cut), None)
    if wrong and not is_proven:
        raise StructureError(f"damaged: a PNG chunk with a wrong checksum at byte {wrong.place}")
    if unpacked < wanted:
        lost = 1 - unpacked / wanted
        raise StructureError(
            f"truncated: the PNG's data end before the picture does, {lost:.0%} of {height} rows are missing"
        )


def _unpacked(pieces: list[_Chunk], wanted: int) -> tuple[int, bool]:
    """How many bytes the pieces unpack to, at least as many as `wanted` if there are; and whether their own checksum is right."""
    unpacking, count = zlib.decompressobj(), 0
    for piece in pieces:
        packed: bytes | memoryview = piece.data
        while not unpacking.eof and count <= wanted:
            try:
                more = unpacking.decompress(packed, AT_ONCE)
            except zlib.error:
                return count, False
            count, packed = count + len(more), unpacking.unconsumed_tail
            if not packed and len(more) < AT_ONCE:
                break
    return count, unpacking.eof
