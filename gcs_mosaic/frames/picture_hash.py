"""Identity of a file's picture, whatever is told beside it: programs that write tags into files leave the picture as it is.

Nothing is decoded. Sources: ITU-T T.81 annex B, PNG 1.2, TIFF 6.0.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from hashlib import blake2b

from gcs_mosaic.frames.structure import StructureError, unpack
from gcs_mosaic.frames.tiff import first_page

_SCAN, _END, _COMMENT = 0xDA, 0xD9, 0xFE
_TOLD = {*range(0xE0, 0xF0), _COMMENT} - {
    0xEE
}  # segments that say something; Adobe's (APP14) says how colours are stored
_MARKER = re.compile(rb"\xff([^\x00\xff\x01\xd0-\xd7])")
_CHUNKS = (b"IHDR", b"PLTE", b"tRNS", b"IDAT")


def picture_hash(data: bytes) -> str | None:
    """The same for two files (JPEG, PNG or TIFF) only if they hold the same picture in the same encoding; None if not known."""
    parts = (
        _parts_of_jpeg
        if data.startswith(b"\xff\xd8")
        else _parts_of_png
        if data.startswith(b"\x89PNG")
        else _parts_of_tiff
    )
    digest = blake2b(digest_size=16)
    try:
        for part in parts(data):
            digest.update(part)
    except StructureError:
        return None
    return digest.hexdigest()


def _parts_of_jpeg(data: bytes) -> Iterator[bytes | memoryview]:
    """All but what is told, up to the end of the picture; what follows (previews, videos) is not of it."""
    position, view = 2, memoryview(data)
    while found := _MARKER.search(data, position):
        marker, start = found[1][0], found.end()
        if marker in (_SCAN, _END):
            end = data.find(b"\xff\xd9", start)
            yield view[start : end if end >= 0 else len(data)]
            return
        (length,) = unpack(">H", data, start)
        position = start + max(length, 2)
        if marker not in _TOLD:
            yield view[start - 1 : position]
    raise StructureError("truncated: no picture yet")


def _parts_of_png(data: bytes) -> Iterator[bytes | memoryview]:
    position, view = 8, memoryview(data)
    while position < len(data):
        (length,) = unpack(">I", data, position)
        end = position + 12 + length
        if data[position + 4 : position + 8] in _CHUNKS:
            yield view[position + 4 : end]
        position = end


def _parts_of_tiff(data: bytes) -> Iterator[bytes | memoryview]:
    page, view = first_page(data), memoryview(data)
    yield data[:2]  # the order of bytes
    yield repr(replace(page, pieces=())).encode()
    for offset, count in page.pieces:
        yield view[offset : offset + count]
