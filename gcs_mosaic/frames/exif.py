"""Capture time by the camera's clock: EXIF's DateTimeOriginal and SubSecTimeOriginal of a JPEG or a TIFF.

Used only to order frames, to find the trigger of each, and to tell people when it was taken; and the texts of a TIFF's first
directory, for `temperature`. Sources: EXIF 2.32, TIFF 6.0,
ITU-T T.81, annex B, and the BigTIFF of libtiff.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from io import SEEK_END, BytesIO
from pathlib import Path
from typing import BinaryIO

from gcs_mosaic.frames.structure import StructureError, unpack

_EXIF_DIRECTORY, _DATE_TIME_ORIGINAL, _SUB_SECONDS = 0x8769, 0x9003, 0x9291
_TEXT = 2  # field type
_BYTES = {1, 2, 7}  # those of single bytes: BYTE, ASCII, UNDEFINED
_OFFSETS = {4: "I", 8: "Q"}  # by the size of an entry's value: TIFF, BigTIFF
_POINTERS = {4: "I", 13: "I", 16: "Q", 18: "Q"}  # LONG, IFD, and BigTIFF's LONG8 and IFD8: their struct formats
_DATE = re.compile(r"(\d{4}):(\d\d):(\d\d) (\d\d):(\d\d):(\d\d)", re.ASCII)
_APP1, _START_OF_SCAN, _END = 0xE1, 0xDA, 0xD9

MOST_SEGMENTS = 64  # before a JPEG's image data; cameras write fewer than ten
MOST_ENTRIES = 512  # of a directory; cameras write a few dozen
LONGEST_TEXT = 64  # bytes; a date has 20
LONGEST_DOCUMENT = 1 << 18  # bytes of one text of `first_texts`: an XMP packet has a few thousand


def capture_time(path: Path, note: Callable[[str], None] = lambda text: None) -> datetime | None:
    """The time by the camera's clock, whose time zone is unknown; None if the file has no readable one.

    `note` receives a sentence if the file is at fault.
    """
    try:
        with path.open("rb") as file:
            return _of_file(file)
    except (OSError, StructureError) as error:
        note(f"{path.name}: when it was taken cannot be read: {error}")
        return None


def captured_s(data: bytes) -> float | None:
    """The same of a whole file, in seconds since 1970 as if the clock showed UTC."""
    return captured_in(BytesIO(data))


def captured_in(file: BinaryIO) -> float | None:
    """The same of an open file, of which little is read. Raises OSError."""
    try:
        moment = _of_file(file)
    except StructureError:
        return None
    return None if moment is None else moment.replace(tzinfo=UTC).timestamp()


def first_texts(file: BinaryIO, tags: Sequence[int]) -> dict[int, str]:
    """Texts of an open TIFF's first directory by tag, those that are there. Raises OSError and StructureError."""
    file.seek(0)
    if not file.read(4).startswith((b"II", b"MM")):
        return {}
    block = _Block(file, 0, file.seek(0, SEEK_END))
    order, entries = _first_directory(block)
    found: dict[int, str] = {}
    for tag in tags:
        kind, count, value = entries.get(tag, (0, 0, b""))
        if kind not in _BYTES or count > LONGEST_DOCUMENT:
            continue
        if count > len(value):
            (at,) = unpack(order + _OFFSETS[len(value)], value, 0)
            value = block.read(at, count)
        found[tag] = value[:count].split(b"\0")[0].decode("utf-8", "replace")
    return found


def _of_file(file: BinaryIO) -> datetime | None:
    magic = file.read(4)
    if magic.startswith(b"\xff\xd8\xff"):
        return _of_jpeg(file)
    return _of_tiff(_Block(file, 0, file.seek(0, SEEK_END))) if magic.startswith((b"II", b"MM")) else None


@dataclass(frozen=True, slots=True)
class _Block:
    """A TIFF structure within a file, starting at byte `start`; each read is limited to the bytes requested."""

    file: BinaryIO
    start: int
    length: int

    def read(self, offset: int, count: int) -> bytes:
        """Exactly `count` bytes; raises StructureError if there are fewer."""
        if offset + count > self.length:
            raise StructureError("damaged: EXIF points beyond its end")
        self.file.seek(self.start + offset)
        data = self.file.read(count)
        if len(data) != count:
            raise StructureError("truncated: the file ends within EXIF")
        return data


def _of_jpeg(file: BinaryIO) -> datetime | None:
    """Walks the segments, reading only their headers, up to the image data."""
    at = 2
    for _ in range(MOST_SEGMENTS):
        file.seek(at)
        head = file.read(10)
        if (fill := len(head) - len(head.lstrip(b"\xff")) - 1) > 0:  # fill bytes may precede a marker
            at += fill
            continue
        mark, marker, length = unpack(">BBH", head, 0)
        if mark != 0xFF or marker in (_START_OF_SCAN, _END) or length < 2:
            return None
        if marker == _APP1 and head[4:] == b"Exif\0\0":
            return _of_tiff(_Block(file, at + 10, length - 8))
        at += 2 + length
    return None


def _first_directory(block: _Block) -> tuple[str, dict[int, _Entry]]:
    """Byte order, and the entries of the first directory."""
    head = block.read(0, 8)
    order = "<" if head.startswith(b"II") else ">"
    kind, first = unpack(order + "HI", head, 2)
    if kind == 43:  # BigTIFF
        (first,) = unpack(order + "Q", block.read(8, 8), 0)
    elif kind != 42:
        raise StructureError("damaged: neither TIFF nor BigTIFF")
    return order, _directory(block, order, first, big=kind == 43)


def _of_tiff(block: _Block) -> datetime | None:
    order, outer = _first_directory(block)
    if _EXIF_DIRECTORY not in outer:
        return None
    kind_of, _, value = outer[_EXIF_DIRECTORY]
    if kind_of not in _POINTERS:
        return None
    inner = _directory(block, order, *unpack(order + _POINTERS[kind_of], value, 0), big=len(value) == 8)
    date, fraction = (_text(block, order, inner.get(tag)) for tag in (_DATE_TIME_ORIGINAL, _SUB_SECONDS))
    return _moment(date, fraction)


_Entry = tuple[int, int, bytes]  # field type, number of values, and the values or their offset


def _directory(block: _Block, order: str, at: int, *, big: bool) -> dict[int, _Entry]:
    """The entries of the directory at `at` by tag, the first of each; the offset of a next directory is ignored."""
    form, count_form = ("HHQ8s", "Q") if big else ("HHI4s", "H")
    count_size, size = struct.calcsize(order + count_form), struct.calcsize(order + form)
    (count,) = unpack(order + count_form, block.read(at, count_size), 0)
    if count > MOST_ENTRIES:
        raise StructureError(f"damaged: a directory of {count} entries")
    data = block.read(at + count_size, count * size)
    entries: dict[int, _Entry] = {}
    for tag, kind, values, value in struct.iter_unpack(order + form, data):
        entries.setdefault(tag, (kind, values, value))
    return entries


def _text(block: _Block, order: str, entry: _Entry | None) -> str:
    """A text value up to its terminator; empty if there is none."""
    if entry is None or entry[0] != _TEXT or entry[1] > LONGEST_TEXT:
        return ""
    _, count, value = entry
    if count > len(value):
        (at,) = unpack(order + ("Q" if len(value) == 8 else "I"), value, 0)
        value = block.read(at, count)
    return value[:count].split(b"\0")[0].decode("ascii", "replace").strip()


def _moment(date: str, fraction: str) -> datetime | None:
    """Parse "2021:06:05 14:03:59" and the fractional digits of its seconds; None if invalid."""
    found = _DATE.fullmatch(date)
    if not found:
        return None
    try:
        moment = datetime(*map(int, found.groups()))  # type: ignore[arg-type]
    except ValueError:
        return None
    digits = fraction[:6] if fraction.isascii() and fraction.isdecimal() else ""
    return moment + timedelta(microseconds=int(digits.ljust(6, "0")))
