"""JPEG: walks the markers to the actual end. Source: ITU-T T.81, annex B."""

from __future__ import annotations

import re
from collections.abc import Iterator

from gcs_mosaic.frames.structure import StructureError, Whole, unpack

_END, _SCAN = 0xD9, 0xDA
_FRAMES = set(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}  # SOFn, which contain the size
_PROGRESSIVE = {0xC2, 0xC6, 0xCA, 0xCE}
# The marker of a segment, after fill bytes, padding (which decoders skip) and markers without a segment, in any number.
_NEXT_MARKER = re.compile(rb"\xff+([^\x00\xff\x01\xd0-\xd7])")
# In entropy-coded data 0xFF is followed by zero, a restart marker or a fill byte; anything else ends the scan.
_AFTER_SCAN = re.compile(rb"\xff[^\x00\xd0-\xd7\xff]")
MOST_SEGMENTS = 100_000  # thermal cameras put 10 MB of data into some hundred


def jpeg_header(data: bytes) -> Whole:
    """Size and bands; raises StructureError if the main image's end marker, or a colour component, is missing.

    A thumbnail's end marker lies inside a segment and is skipped; data after the end is ignored.
    """
    size, scanned = None, set[int]()
    for marker, content in _segments(data):
        if marker in _FRAMES:
            size = unpack(">xxBHHB", data, content)
        elif marker == _SCAN:
            scanned |= _components_of_scan(data, content)
    if size is None or not scanned:
        raise StructureError("damaged: a JPEG without a picture")
    bits, height, width, components = size
    if len(scanned) < components:
        raise StructureError(f"damaged: a JPEG with {len(scanned)} of {components} colour components")
    return Whole(width, height, 1 if components == 1 else 3, bits)


def is_progressive(data: bytes) -> bool:
    """Whether a complete JPEG comes in scans of which each refines the whole picture."""
    return any(marker in _PROGRESSIVE for marker, _ in _segments(data))


def _segments(data: bytes) -> Iterator[tuple[int, int]]:
    """(marker, offset of its content) of every segment before the end marker; raises StructureError if there is no end."""
    position = 2
    for _ in range(MOST_SEGMENTS):
        marker, content = _marker(data, position)
        if marker == _END:
            return
        yield marker, content
        (length,) = unpack(">H", data, content)
        position = content + max(length, 2)
        if marker == _SCAN:
            position = _end_of_scan(data, position)
    raise StructureError(f"damaged: a JPEG of more than {MOST_SEGMENTS} segments")


def _marker(data: bytes, position: int) -> tuple[int, int]:
    """The next marker of a segment, from `position` on, and the offset of its content."""
    found = _NEXT_MARKER.search(data, position)
    if not found:
        raise StructureError(f"truncated: it ends after {len(data)} bytes")
    return found[1][0], found.end()


def _components_of_scan(data: bytes, content: int) -> set[int]:
    (count,) = unpack(">xxB", data, content)
    return set(unpack(f">{2 * count}B", data, content + 3)[::2])


def _end_of_scan(data: bytes, position: int) -> int:
    found = _AFTER_SCAN.search(data, position)
    if not found:
        raise StructureError("truncated: the picture has no end yet")
    return found.start()
