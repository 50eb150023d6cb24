"""Parsing the structure of a file that may be truncated anywhere."""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass

_BEGIN = re.compile(rb"\xff\xd8\xff[\xc0-\xfe]|\x89PNG\r\n\x1a\n")
_TIFF = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
MOST_JUNK = 1 << 16  # bytes in front of a picture: a transfer's head, a maker's block, the zeros of a sector
# Files of other kinds, which have previews inside that are no frames; RIFF and its like at 0, ISO media (MP4, HEIC, CR3) at 4.
_OTHERS = (b"%PDF", b"PK\3\4", b"RIFF", b"GIF8", b"FUJIFILM", b"8BPS", b"ID3", b"OggS", b"\x1aE\xdf\xa3")
_MEDIA = (b"ftyp", b"moov", b"mdat", b"wide", b"free", b"jP  ", b"JXL ")
# What such bytes are called, for whoever has given them another file's ending: converters, phones and browsers do.
_BRANDS = {b"heic": "HEIC", b"heix": "HEIC", b"mif1": "HEIC", b"avif": "AVIF", b"crx ": "RAW (CR3)"}
_NAMES = {
    b"\xff\x0a": "JPEG XL",
    b"\0\0\0\x0cJXL ": "JPEG XL",
    b"\0\0\0\x0cjP  ": "JPEG 2000",
    b"\xff\x4f\xff\x51": "JPEG 2000",
    b"GIF8": "GIF",
    b"BM": "BMP",
    b"%PDF": "PDF",
    b"PK\3\4": "a ZIP archive",
    b"FUJIFILM": "RAW (Fujifilm)",
}


class StructureError(Exception):
    """The file is truncated or malformed; the message says where. Never leaves this package."""


@dataclass(frozen=True, slots=True)
class Whole:
    """An image of `width` x `height` pixels, as stored (no orientation applied); transparency is not a band.

    `doubt`: why its structure does not prove that all of it is there, empty if it does. Then more of the file may come, and
    when nothing does, decoding decides.
    """

    width: int
    height: int
    bands: int = 3
    bits: int = 8  # per band
    doubt: str = ""


def unpack(form: str, data: bytes | memoryview, offset: int) -> tuple[int, ...]:
    """Like `struct.unpack_from`; raises StructureError if out of bounds."""
    if offset < 0 or offset + struct.calcsize(form) > len(data):
        raise StructureError(f"truncated: it ends after {len(data)} bytes")
    return struct.unpack_from(form, data, offset)


def image_start(data: bytes) -> tuple[str, int] | None:
    """Kind (jpeg, png or tiff) and offset of the first byte of the image in `data`, which may have junk in front; None if there
    is none."""
    if data.startswith(_TIFF):
        return "tiff", 0
    if data.startswith(_OTHERS) or data[4:8] in _MEDIA:
        return None
    if data.startswith(b"\xff\xd8\xff"):
        return "jpeg", 0
    found = _BEGIN.search(data, 0, MOST_JUNK)
    return found and ("jpeg" if found[0].startswith(b"\xff") else "png", found.start())


def other_kind(data: bytes) -> str:
    """What bytes that are no JPEG, PNG or TIFF begin like, in words; empty if that is not known."""
    if data.startswith(b"RIFF"):
        return "WebP" if data[8:12] == b"WEBP" else "an AVI video or sound"
    if data[4:8] == b"ftyp":
        return _BRANDS.get(data[8:12], "an MP4 or MOV video")
    if data[:64].removeprefix(b"\xef\xbb\xbf").lstrip().startswith((b"<", b"{")):
        return "text, such as a web page or an error message"
    return next((name for magic, name in _NAMES.items() if data.startswith(magic)), "")
