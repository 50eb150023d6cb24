"""JPEG: walks the markers to where the picture ends, whatever a maker has put before, between and behind its parts.

Source: ITU-T T.81, annex B; what decoders pass over: libjpeg's `jdmarker.c`.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field

from gcs_mosaic.frames.jpeg_segments import FRAMES, JpegFrame, JpegScan, frame_of, is_refined, is_table, scan_of
from gcs_mosaic.frames.structure import StructureError, Whole, image_start, unpack

_START, _END, _SCAN, _NO_LINES = 0xD8, 0xD9, 0xDA, 0xDC
_TABLES = {0xC4, 0xCC, 0xDB, 0xDD}  # DHT, DAC, DQT, DRI
_COMMENTS = {*range(0xE0, 0xF0), 0xFE}  # APPn and COM
_OF_COLOUR = {0xE0: b"JFIF\0", 0xEE: b"Adobe"}  # those that say how colours are stored
# The marker of a segment, after fill bytes, padding (which decoders skip) and markers without a segment, in any number.
_NEXT_MARKER = re.compile(rb"\xff([^\x00\xff\x01\xd0-\xd7])")
# In entropy-coded data 0xFF is followed by zero, a restart marker or a fill byte; anything else ends the scan.
_AFTER_SCAN = re.compile(rb"\xff[^\x00\xd0-\xd7\xff]")
PADDING, PADDED_TIMES = 16, 8  # so many zeros, or ones, at the end are no picture; so many of such in turn
BLOCK = 1 << 16  # bytes of padding looked at together
NESTED = 2  # pictures in pictures
MOST_WRONG = 16  # segments with a wrong length
MOST_SEGMENTS = 100_000  # thermal cameras put 10 MB of data into some hundred


@dataclass(slots=True)
class JpegPicture:
    """The main picture of a file: what a decoder needs of it, as (begin, end) of each segment or scan, in order.

    `ended`: it has an end marker. `doubt` as in `Whole`. `end`: offset behind all of it.
    """

    frame: JpegFrame | None = None
    scans: list[JpegScan] = field(default_factory=list)
    parts: list[tuple[int, int]] = field(default_factory=list)
    ended: bool = False
    doubt: str = ""
    end: int = 0
    suspect: int | None = None  # where the content of a segment begins whose length may be wrong
    wrong: int = 0  # how many were
    depth: int = 0  # how many pictures it lies in

    def doubted(self, why: str) -> None:
        """The first reason counts."""
        self.doubt = self.doubt or why


def jpeg_header(data: bytes) -> Whole:
    """Size and bands; raises StructureError if there is no picture (yet), or if a colour component or a scan is missing.

    A thumbnail lies inside a segment and is skipped; data after the picture's end are ignored.
    """
    picture = jpeg_picture(data)
    frame = picture.frame
    if frame is None or not picture.scans:
        raise StructureError("damaged: a JPEG without a picture" if picture.ended else _ends_after(data))
    scanned = {component for scan in picture.scans for component in scan.components}
    if len(scanned) < len(frame.components):
        raise StructureError(f"damaged: a JPEG with {len(scanned)} of {len(frame.components)} colour components")
    if not picture.ended and frame.is_progressive and not is_refined(frame, picture.scans):
        raise StructureError("truncated: the last scans of a progressive JPEG are missing")
    bands = 1 if len(frame.components) == 1 else 3
    return Whole(frame.width, frame.height, bands, frame.bits, picture.doubt)


def jpeg_picture(data: bytes, start: int | None = None, depth: int = 0) -> JpegPicture:
    """What there is of the picture, the first one or that at `start`. Raises StructureError if it has too many segments."""
    picture = JpegPicture(depth=depth)
    if start is None:
        _, start = image_start(data) or ("jpeg", 0)
        picture.doubt = "it has other bytes in front" if start else ""
    picture.end = start + 2
    for _ in range(MOST_SEGMENTS):
        following = _next_segment(data, picture, picture.end)
        if following is None:
            return picture
        picture.end = following
    raise StructureError(f"damaged: a JPEG of more than {MOST_SEGMENTS} segments")


def _next_segment(data: bytes, picture: JpegPicture, position: int) -> int | None:
    """Take up the next segment from `position` on; where to go on, None at the end of the picture."""
    found = _NEXT_MARKER.search(data, position)
    if found is None:
        if not picture.scans and picture.suspect is not None and picture.wrong < MOST_WRONG:
            return _after_junk(data, picture, 0, position, position)
        picture.doubted("it has no end marker")
        return None
    marker, content = found[1][0], found.end()
    end = _end_of_segment(data, content)
    if marker == _END and picture.scans:
        picture.ended, picture.end = True, content
        return None
    following = _segment(data, picture, marker, content, end) if end else None
    if following is not None:
        return following
    if picture.scans:  # no decoder goes on here: another picture, a maker's trailer, a video
        picture.doubted("something else follows its data without an end marker")
        return None
    return _after_junk(data, picture, marker, content, position)


def _segment(data: bytes, picture: JpegPicture, marker: int, content: int, end: int) -> int | None:
    """Where to go on after this segment, None if it cannot be one."""
    if marker == _SCAN and picture.frame and (scan := scan_of(data, content, end, picture.frame)):
        return _take_scan(data, picture, scan, content - 2, end)
    if marker in FRAMES and picture.frame is None and (frame := frame_of(data, content, end, marker)):
        picture.frame = frame
        return _keep(picture, content - 2, end)
    if marker in _TABLES and is_table(data, content, end, marker):
        return _keep(picture, content - 2, end)
    if marker in _COMMENTS:
        return _after_comment(data, picture, marker, content, end)
    return end if marker == _NO_LINES and end == content + 4 else None


def _after_comment(data: bytes, picture: JpegPicture, marker: int, content: int, end: int) -> int | None:
    if not _is_marker(data, end):
        # Padding, which decoders pass over; or its length is wrong, and what is looked for lies within what it spans.
        if picture.scans:
            return None
        picture.suspect = content + 2
        if b"\xff\xd8\xff" in data[content:end]:
            return _after_junk(data, picture, marker, content, content)
    if data.startswith(_OF_COLOUR.get(marker, b"?"), content + 2):
        _keep(picture, content - 2, end)
    return end


def _after_junk(data: bytes, picture: JpegPicture, marker: int, content: int, position: int) -> int:
    """Behind what is no segment. A picture within that is a preview that a wrong length has laid bare."""
    if picture.suspect is not None and picture.wrong < MOST_WRONG:
        picture.doubted("a segment's length is wrong")
        position, picture.suspect, picture.wrong = picture.suspect, None, picture.wrong + 1
        return position
    if marker != _START or (content - 2 == position and not picture.parts):  # some write the first marker twice
        picture.doubted("it has bytes between its segments that are none")
        return content
    picture.doubted("another picture lies among its segments")
    nested = jpeg_picture(data, content - 2, picture.depth + 1) if picture.depth < NESTED else None
    return nested.end if nested and nested.ended else len(data)


def _take_scan(data: bytes, picture: JpegPicture, scan: JpegScan, begin: int, end: int) -> int:
    found = _AFTER_SCAN.search(data, end)
    picture.scans.append(scan)
    picture.parts.append((begin, found.start() if found else _end_without_padding(data, end)))
    return found.start() if found else len(data)


def _end_without_padding(data: bytes, begin: int) -> int:
    """Where, from `begin` on, nothing but padding follows, or half a marker."""
    end = len(data)
    for _ in range(PADDED_TIMES):
        last = data[end - 1 : end]
        stripped = _stripped(data, begin, end, last) if last in (b"\0", b"\xff") else end
        if end - stripped < PADDING:
            break
        end = stripped
    return _stripped(data, begin, end, b"\xff")


def _stripped(data: bytes, begin: int, end: int, byte: bytes) -> int:
    """The end of `data[begin:end]` without its last bytes of this value; nothing large is copied."""
    while end - begin >= BLOCK and data[end - BLOCK : end] == byte * BLOCK:
        end -= BLOCK
    start = max(begin, end - BLOCK)
    return start + len(data[start:end].rstrip(byte))


def _keep(picture: JpegPicture, begin: int, end: int) -> int:
    picture.parts.append((begin, end))
    return end


def _end_of_segment(data: bytes, content: int) -> int | None:
    """None if the file ends before."""
    if content + 2 > len(data):
        return None
    (length,) = unpack(">H", data, content)
    end = content + max(length, 2)
    return end if end <= len(data) else None


def _is_marker(data: bytes, position: int) -> bool:
    return data[position : position + 1] == b"\xff" and data[position + 1 : position + 2] not in (b"", b"\0")


def _ends_after(data: bytes) -> str:
    return f"truncated: it ends after {len(data)} bytes"
