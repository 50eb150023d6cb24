"""JPEG: walks the markers to the actual end. Source: ITU-T T.81, annex B."""

from __future__ import annotations

import re

from gcs_mosaic.frames.structure import StructureError, Whole, unpack

_END, _SCAN = 0xD9, 0xDA
_ALONE = {0x01, *range(0xD0, 0xD8)}  # markers without a segment
_FRAMES = set(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}  # SOFn, which contain the size
_MARKER = re.compile(rb"\xff+([^\xff\x00])")
# In entropy-coded data 0xFF is followed by zero, a restart marker or a fill byte; anything else ends the scan.
_AFTER_SCAN = re.compile(rb"\xff[^\x00\xd0-\xd7\xff]")


def jpeg_header(data: bytes) -> Whole:
    """Size and bands; raises StructureError if the main image's end marker is missing.

    A thumbnail's end marker lies inside a segment and is skipped; data after the end is ignored.
    """
    position, size, scans = 2, None, 0
    while True:
        marker, position = _marker(data, position)
        if marker == _END:
            break
        if marker in _ALONE:
            continue
        (length,) = unpack(">H", data, position)
        if marker in _FRAMES:
            size = unpack(">xxBHHB", data, position)
        position += max(length, 2)
        if marker == _SCAN:
            position, scans = _end_of_scan(data, position), scans + 1
    if size is None or not scans:
        raise StructureError("damaged: a JPEG without a picture")
    bits, height, width, components = size
    return Whole(width, height, 1 if components == 1 else 3, bits)


def _marker(data: bytes, position: int) -> tuple[int, int]:
    """The marker at `position` and its end; fill bytes before it are allowed."""
    unpack("BB", data, position)
    found = _MARKER.match(data, position)
    if not found:
        raise StructureError(f"damaged: no JPEG marker at byte {position}")
    return found[1][0], found.end()


def _end_of_scan(data: bytes, position: int) -> int:
    found = _AFTER_SCAN.search(data, position)
    if not found:
        raise StructureError("truncated: the picture has no end yet")
    return found.start()
