"""Reads the capture time from a JPEG's EXIF data, robust against malformed files."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

HEAD = 256 * 1024  # bytes read per file: the EXIF segment comes first and is at most 64 KiB
EXIF_IFD, DATE_TIME_ORIGINAL, SUB_SECONDS = 0x8769, 0x9003, 0x9291


def taken_at(path: Path) -> float | None:
    """EXIF DateTimeOriginal in seconds (camera clock taken as UTC); None if there is no readable one."""
    with path.open("rb") as file:
        head = file.read(HEAD)
    for segment in exif_segments(head):
        try:
            return date_of(segment)
        except (struct.error, KeyError, ValueError, UnicodeDecodeError):
            continue
    return None


def exif_segments(data: bytes) -> Iterator[bytes]:
    """TIFF blocks of a JPEG's APP1 segments."""
    at = 2 if data[:2] == b"\xff\xd8" else len(data)
    while at + 4 <= len(data) and data[at] == 0xFF and data[at + 1] != 0xDA:
        (length,) = struct.unpack_from(">H", data, at + 2)
        if data[at + 1] == 0xE1 and data[at + 4 : at + 10] == b"Exif\0\0":
            yield data[at + 10 : at + 2 + length]
        at += 2 + length


def date_of(tiff: bytes) -> float:
    """Date in a TIFF block. Raises KeyError, ValueError or struct.error if there is no readable one."""
    order = {b"II": "<", b"MM": ">"}[tiff[:2]]
    (first,) = struct.unpack_from(order + "I", tiff, 4)
    (inner,) = struct.unpack(order + "I", directory(tiff, order, first)[EXIF_IFD])
    tags = directory(tiff, order, inner)
    moment = datetime.strptime(text(tags[DATE_TIME_ORIGINAL]), "%Y:%m:%d %H:%M:%S").replace(tzinfo=UTC)
    fraction = text(tags.get(SUB_SECONDS, b""))
    return moment.timestamp() + (float(f"0.{fraction}") if fraction.isdecimal() and fraction.isascii() else 0.0)


def directory(tiff: bytes, order: str, at: int) -> dict[int, bytes]:
    """Tags of one IFD with ASCII or LONG values, as raw bytes."""
    (count,) = struct.unpack_from(order + "H", tiff, at)
    tags = {}
    for k in range(count):
        tag, kind, size = struct.unpack_from(order + "HHI", tiff, at + 2 + 12 * k)
        place = at + 2 + 12 * k + 8
        length = size * {2: 1, 4: 4}.get(kind, 0)
        if length > 4:
            (place,) = struct.unpack_from(order + "I", tiff, place)
        tags[tag] = tiff[place : place + length]
        if len(tags[tag]) < length:
            raise ValueError("cut off")
    return tags


def text(raw: bytes) -> str:
    return raw.split(b"\0")[0].decode("ascii").strip()
