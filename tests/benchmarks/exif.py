"""The position that a camera has written into a JPEG or TIFF (EXIF 2.32, section 4.6.6): nothing more of EXIF than that."""

from __future__ import annotations

import math
import struct
from pathlib import Path

ENOUGH = (
    1 << 18
)  # bytes at the beginning of a file: EXIF is in the first 64 KiB of a JPEG, but may follow other segments
_GPS_DIRECTORY = 0x8825
_LATITUDE_SIDE, _LATITUDE, _LONGITUDE_SIDE, _LONGITUDE = 1, 2, 3, 4
_ASCII, _LONG, _RATIONAL = 2, 4, 5
_SIZES = {1: 1, _ASCII: 1, 3: 2, _LONG: 4, _RATIONAL: 8, 7: 1, 9: 4, 10: 8}  # bytes of a value, by kind


def position_in(path: Path) -> tuple[float, float] | None:
    """Latitude and longitude in degrees, north and east positive; None where a file has none, or 0, 0."""
    with path.open("rb") as file:
        return position_of(file.read(ENOUGH))


def position_of(data: bytes) -> tuple[float, float] | None:
    """The same of the beginning of a file."""
    try:
        tiff = _tiff_of(data)
        order = {b"II": "<", b"MM": ">"}[tiff[:2]]
        (first,) = struct.unpack_from(order + "I", tiff, 4)
        (gps,) = struct.unpack(order + "I", _directory(tiff, order, first)[_GPS_DIRECTORY][:4])
        fields = _directory(tiff, order, gps)
        latitude = _degrees(fields[_LATITUDE], order) * (-1 if fields[_LATITUDE_SIDE][:1] == b"S" else 1)
        longitude = _degrees(fields[_LONGITUDE], order) * (-1 if fields[_LONGITUDE_SIDE][:1] == b"W" else 1)
    except (KeyError, ValueError, ZeroDivisionError, struct.error):
        return None
    return (latitude, longitude) if latitude or longitude else None


def _tiff_of(data: bytes) -> bytes:
    """The TIFF file that EXIF is, out of a JPEG; anything else is taken for one itself. ValueError where there is none."""
    if not data.startswith(b"\xff\xd8"):
        return data
    at = 2
    while True:
        marker, length = struct.unpack_from(">HH", data, at)
        if marker == 0xFFDA or marker < 0xFF00:
            raise ValueError("no EXIF before the picture")
        if marker == 0xFFE1 and data[at + 4 : at + 10] == b"Exif\0\0":
            return data[at + 10 : at + 2 + length]
        at += 2 + length


def _directory(tiff: bytes, order: str, at: int) -> dict[int, bytes]:
    """The values of a directory's fields, as bytes, by tag."""
    (count,) = struct.unpack_from(order + "H", tiff, at)
    fields = {}
    for entry in range(at + 2, at + 2 + 12 * count, 12):
        tag, kind, values = struct.unpack_from(order + "HHI", tiff, entry)
        size = _SIZES.get(kind, 0) * values
        (place,) = struct.unpack_from(order + "I", tiff, entry + 8) if size > 4 else (entry + 8,)
        fields[tag] = tiff[place : place + size]
    return fields


def _degrees(value: bytes, order: str) -> float:
    """Degrees, minutes and seconds as fractions; a camera may leave minutes or seconds as 0/0."""
    numbers = struct.unpack(order + "6I", value)
    parts = [top / bottom if top or bottom else 0.0 for top, bottom in zip(numbers[::2], numbers[1::2], strict=True)]
    return math.fsum(part / 60**power for power, part in enumerate(parts))
