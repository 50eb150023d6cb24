"""Reads the capture time and the position from a JPEG's EXIF data, robust against malformed files."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import TypeVar

HEAD = 256 * 1024  # bytes read per file: the EXIF segment comes first and is at most 64 KiB
EXIF_IFD, DATE_TIME_ORIGINAL, SUB_SECONDS = 0x8769, 0x9003, 0x9291
GPS_IFD, LATITUDE_REF, LATITUDE, LONGITUDE_REF, LONGITUDE, ALTITUDE = 0x8825, 1, 2, 3, 4, 6
BYTES = {2: 1, 4: 4, 5: 8}  # of a value: ASCII, LONG, RATIONAL
Told = TypeVar("Told")


def taken_at(path: Path) -> float | None:
    """EXIF DateTimeOriginal in seconds (camera clock taken as UTC); None if there is no readable one."""
    return first_told(path, date_of)


def located_at(path: Path) -> tuple[float, float, float] | None:
    """EXIF latitude and longitude in degrees, altitude in metres; None if there is no readable one."""
    return first_told(path, place_of)


def first_told(path: Path, read: Callable[[bytes], Told]) -> Told | None:
    with path.open("rb") as file:
        head = file.read(HEAD)
    for segment in exif_segments(head):
        try:
            return read(segment)
        except (struct.error, KeyError, ValueError, UnicodeDecodeError, ZeroDivisionError):
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


def place_of(tiff: bytes) -> tuple[float, float, float]:
    """Position in a TIFF block. Raises KeyError, ValueError, ZeroDivisionError or struct.error if there is no readable one."""
    order, tags = inner_directory(tiff, GPS_IFD)
    latitude, longitude = (degrees(tags[key], order) for key in (LATITUDE, LONGITUDE))
    south, west = text(tags[LATITUDE_REF]) == "S", text(tags[LONGITUDE_REF]) == "W"
    altitude = ratios(tags[ALTITUDE], order)[0] if ALTITUDE in tags else 0.0
    if abs(latitude) > 90 or abs(longitude) > 180:
        raise ValueError("no place on earth")
    return -latitude if south else latitude, -longitude if west else longitude, altitude


def degrees(raw: bytes, order: str) -> float:
    whole, minutes, seconds = ratios(raw, order)
    return whole + minutes / 60 + seconds / 3600


def ratios(raw: bytes, order: str) -> list[float]:
    numbers = struct.unpack(f"{order}{len(raw) // 4}I", raw)
    return [above / below for above, below in zip(numbers[::2], numbers[1::2], strict=True)]


def date_of(tiff: bytes) -> float:
    """Date in a TIFF block. Raises KeyError, ValueError or struct.error if there is no readable one."""
    _, tags = inner_directory(tiff, EXIF_IFD)
    moment = datetime.strptime(text(tags[DATE_TIME_ORIGINAL]), "%Y:%m:%d %H:%M:%S").replace(tzinfo=UTC)
    fraction = text(tags.get(SUB_SECONDS, b""))
    return moment.timestamp() + (float(f"0.{fraction}") if fraction.isdecimal() and fraction.isascii() else 0.0)


def inner_directory(tiff: bytes, tag: int) -> tuple[str, dict[int, bytes]]:
    """Byte order of a TIFF block, and the tags of the directory that its first one points to."""
    order = {b"II": "<", b"MM": ">"}[tiff[:2]]
    (first,) = struct.unpack_from(order + "I", tiff, 4)
    (inner,) = struct.unpack(order + "I", directory(tiff, order, first)[tag])
    return order, directory(tiff, order, inner)


def directory(tiff: bytes, order: str, at: int) -> dict[int, bytes]:
    """Tags of one IFD with ASCII, LONG or RATIONAL values, as raw bytes."""
    (count,) = struct.unpack_from(order + "H", tiff, at)
    tags = {}
    for k in range(count):
        tag, kind, size = struct.unpack_from(order + "HHI", tiff, at + 2 + 12 * k)
        place = at + 2 + 12 * k + 8
        length = size * BYTES.get(kind, 0)
        if length > 4:
            (place,) = struct.unpack_from(order + "I", tiff, place)
        tags[tag] = tiff[place : place + length]
        if len(tags[tag]) < length:
            raise ValueError("cut off")
    return tags


def text(raw: bytes) -> str:
    return raw.split(b"\0")[0].decode("ascii").strip()
