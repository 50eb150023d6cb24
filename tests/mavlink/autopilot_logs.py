"""Small logs as autopilots write them: ArduPilot's DataFlash, PX4's ULog."""

from __future__ import annotations

import struct
from collections.abc import Sequence

GPS_WEEK, GPS_EPOCH, LEAP_S = 2365, 315964800, 18
_FMT = (128, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns")
_FORMATS = {"Q": "Q", "B": "B", "H": "H", "I": "I", "L": "i", "f": "f", "n": "4s", "N": "16s", "Z": "64s"}
_KINDS = {
    "GPS": (130, "QBBIHBffLLf", "TimeUS,I,Status,GMS,GWk,NSats,HDop,VDop,Lat,Lng,Alt"),
    "CAM": (131, "QBHIHLLfff", "TimeUS,I,Img,GPSTime,GPSWeek,Lat,Lng,Alt,RelAlt,GPSAlt"),
    "TRIG": (132, "QBHIHLLfff", "TimeUS,I,Img,GPSTime,GPSWeek,Lat,Lng,Alt,RelAlt,GPSAlt"),
}


def began_utc(gms: int = 0) -> float:
    """UTC of a moment of the GPS week in which the logs are."""
    return GPS_EPOCH + GPS_WEEK * 604800 + gms / 1e3 - LEAP_S


def dataflash(shots: Sequence[tuple[str, float, int]], *, boot_s: float = 10.0) -> bytes:
    """A .BIN that begins at `boot_s` with a GPS fix at `began_utc()`; shots are CAM or TRIG, seconds since then, number."""
    log = _format(*_FMT) + b"".join(
        _format(number, name, form, columns) for name, (number, form, columns) in _KINDS.items()
    )
    boot_us = int(boot_s * 1e6)
    log += _message("GPS", boot_us, 0, 3, 0, GPS_WEEK, 12, 1.0, 1.0, 470000000, 80000000, 500.0)
    for kind, at, count in shots:
        log += _message(
            kind, boot_us + int(at * 1e6), 0, count, 0, GPS_WEEK, 470000000 + count, 80000000, 510.0, 60.0, 510.0
        )
    return log


def ulog(shots: Sequence[tuple[str, float, int]], *, boot_s: float = 10.0, utc: float = 1.75e9) -> bytes:
    """A .ulg that begins at `boot_s` and at this UTC; shots are of camera_trigger or camera_capture, as above."""
    start = int(boot_s * 1e6)
    log = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", start) + _record("B", bytes(40))
    layouts = {
        "camera_trigger": "uint64_t timestamp;uint64_t timestamp_utc;uint32_t seq;bool feedback;",
        "camera_capture": "uint64_t timestamp;uint64_t timestamp_utc;uint32_t seq;double lat;double lon;float alt;int8_t result;",
    }
    for name, layout in layouts.items():
        log += _record("F", f"{name}:{layout}".encode())
    for number, name in enumerate(layouts):
        log += _record("A", struct.pack("<BH", 0, number) + name.encode())
    for name, at, count in shots:
        head = struct.pack("<HQQI", list(layouts).index(name), start + int(at * 1e6), int((utc + at) * 1e6), count)
        log += _record("D", head + (b"\0" if name == "camera_trigger" else struct.pack("<ddfb", 47.0, 8.0, 510.0, 1)))
    return log


def _record(kind: str, payload: bytes) -> bytes:
    return struct.pack("<HB", len(payload), ord(kind)) + payload


def _format(number: int, name: str, form: str, columns: str) -> bytes:
    length = 3 + struct.calcsize("<" + "".join(_FORMATS[letter] for letter in form))
    return b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", number, length, name.encode(), form.encode(), columns.encode())


def _message(kind: str, *values: float) -> bytes:
    number, form, _ = _KINDS[kind]
    return b"\xa3\x95" + bytes([number]) + struct.pack("<" + "".join(_FORMATS[letter] for letter in form), *values)
