"""Positions in metadata within a transport stream: the UAS datalink local set (MISB ST 0601), in SMPTE 336M KLV."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass

from gcs_mosaic.frames.video.track import position_of
from gcs_mosaic.messages import Position

KEY = bytes.fromhex("060e2b34020b01010e01030101000000")
MOST_BYTES = 1 << 16  # of a packet: real ones have some hundred bytes
_CHECKSUM, _TIME, _LATITUDE, _LONGITUDE, _ALTITUDE = 1, 2, 13, 14, 15
_NO_ANGLE = -(2**31)  # "out of range"


@dataclass(frozen=True, slots=True)
class PlatformReport:
    """What one local set tells: when (seconds since 1970), and where the camera was."""

    utc: float | None
    position: Position | None


def read_klv(data: bytes) -> Iterator[PlatformReport]:
    """The local sets in a packet whose checksums agree; nothing else in it is looked at."""
    data, at = data[:MOST_BYTES], 0
    while (at := data.find(KEY, at)) >= 0:
        length, begin = _ber_length(data, at + len(KEY))
        end = begin + length
        if length and end <= len(data) and (report := _report(data[at:end], begin - at)):
            yield report
            at = end
        else:
            at += len(KEY)


def _ber_length(data: bytes, at: int) -> tuple[int, int]:
    """Length and where the value begins; a length of 0 for none that can be read."""
    if at >= len(data):
        return 0, at
    first = data[at]
    if first < 0x80:
        return first, at + 1
    count = first & 0x7F
    if not 1 <= count <= 4:
        return 0, at
    return int.from_bytes(data[at + 1 : at + 1 + count]), at + 1 + count


def _report(packet: bytes, begin: int) -> PlatformReport | None:
    values = _values(packet, begin)
    told = values.get(_CHECKSUM, b"")
    if len(told) != 2 or int.from_bytes(told) != checksum(packet[:-2]):
        return None
    time = values.get(_TIME, b"")
    return PlatformReport(int.from_bytes(time) / 1e6 if len(time) == 8 else None, _position(values))


def _values(packet: bytes, at: int) -> dict[int, bytes]:
    """By tag; tags from 128 on (two bytes) are passed over."""
    values: dict[int, bytes] = {}
    while at < len(packet):
        tag = packet[at]
        at += 1
        while tag & 0x80 and at < len(packet) and packet[at] & 0x80:
            at += 1
        at += tag >> 7
        length, begin = _ber_length(packet, at)
        if begin + length > len(packet):
            break
        values[tag] = packet[begin : begin + length]
        at = max(begin + length, at + 1)
    return values


def _position(values: dict[int, bytes]) -> Position | None:
    latitude, longitude = _angle(values.get(_LATITUDE), 90.0), _angle(values.get(_LONGITUDE), 180.0)
    if latitude is None or longitude is None:
        return None
    altitude = values.get(_ALTITUDE, b"")
    height = int.from_bytes(altitude) / 65535 * 19900 - 900 if len(altitude) == 2 else None
    return position_of(latitude, longitude, height)


def _angle(value: bytes | None, most: float) -> float | None:
    if value is None or len(value) != 4:
        return None
    (number,) = struct.unpack(">i", value)
    return None if number == _NO_ANGLE else number * most / (2**31 - 1)


def checksum(data: bytes) -> int:
    """Sum of its 16-bit words, as MISB ST 0601 has it."""
    return (sum(data[0::2]) * 256 + sum(data[1::2])) & 0xFFFF
