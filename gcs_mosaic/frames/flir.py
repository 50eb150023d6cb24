"""FLIR's radiometric JPEGs: the sensor's own picture, counts of 16 bits, lies in APP1 segments beside its rendering in colours.

The counts are of one scale for the whole flight, where the rendering has another for each frame; they are pixels, and it is these
that are placed and painted, if they are as many as the rendering's. Planck's constants beside them give the scale its words
(`temperature`), no more. Whatever is amiss with the counts, the rendering is the frame: then they count as not there.
Source: ExifTool's documentation of FLIR's tags (FFF), https://exiftool.org/TagNames/FLIR.html.
"""

from __future__ import annotations

import logging
import math
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from typing import BinaryIO

import cv2
import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.frames.structure import StructureError, unpack

logger = logging.getLogger(__name__)

Counts = NDArray[np.uint16]

_APP1, _START_OF_SCAN, _END = 0xE1, 0xDA, 0xD9
_RAW, _CAMERA = 1, 32  # records
_ENTRY, _MOST_ENTRIES = 32, 256  # bytes, and of how many records
_PIXELS, _PNG = 32, b"\x89PNG\r\n\x1a\n"  # offset of pixels in their record
_PLANCK, _PLANCK_2 = 88, 776  # offsets of R1, B, F and of O, R2
_NUMBERED = 8  # bytes: FLIR, zero, one, number of the part, number of the last one
MOST_SEGMENTS = 512  # before a JPEG's data; 256 may be FLIR's
# Cameras write bytes in either order, and not all as they say. Read in the wrong one, what changes least changes most: steps
# between neighbours are 1.1 deviations as in noise, where pictures have 0.5 and less.
CLEARLY_SMOOTHER = 0.8


@dataclass(frozen=True, slots=True)
class FlirCounts:
    """Counts that have not been decoded yet: a PNG or rows of them."""

    width: int
    height: int
    stored: bytes

    def pixels(self) -> Counts | None:
        """(h, w); None if they cannot be decoded or are all the same."""
        stored = self._as_stored()
        if stored is None or stored.min() == stored.max():
            return None
        other = stored.byteswap()
        return other if _roughness(other) < CLEARLY_SMOOTHER * _roughness(stored) else stored

    def _as_stored(self) -> Counts | None:
        """In the order that ExifTool's documentation tells: the low byte first, in PNGs too."""
        if not self.stored.startswith(_PNG):
            return np.frombuffer(self.stored, "<u2", self.width * self.height).reshape(self.height, self.width)
        try:
            found = cv2.imdecode(np.frombuffer(self.stored, np.uint8), cv2.IMREAD_UNCHANGED)
        except cv2.error:
            logger.info("FLIR's counts cannot be decoded", exc_info=True)
            return None
        whole = found is not None and found.dtype == np.uint16 and found.shape == (self.height, self.width)
        return np.asarray(found, np.uint16).byteswap() if whole else None


@dataclass(frozen=True, slots=True)
class Planck:
    """Constants of a camera: a black body's temperature in kelvin is B / ln(R1 / (R2 (count + O)) + F)."""

    r1: float
    b: float
    f: float
    o: float
    r2: float

    def kelvin(self, count: float) -> float:
        """NaN where no temperature has this count."""
        try:
            return self.b / math.log(self.r1 / (self.r2 * (count + self.o)) + self.f)
        except (ZeroDivisionError, ValueError, OverflowError):
            return math.nan


def counts_in(data: bytes, size: tuple[int, int]) -> FlirCounts | None:
    """The counts of a JPEG, if it is FLIR's and they have its size (w, h); None else."""
    try:
        block = _block(BytesIO(data))
        at, length = _record(block, _RAW)
        record = block[at : at + length]
        (order,) = unpack("<H", record, 0)
        width, height = unpack(">HH" if order >= 0x100 else "<HH", record, 2)
    except StructureError:
        return None
    stored = record[_PIXELS:]
    is_png = stored.startswith(_PNG) and stored[16:26] == struct.pack(">IIBB", *size, 16, 0)  # grey, of 16 bits
    if (width, height) != size or not (is_png or len(stored) >= 2 * width * height):
        return None
    return FlirCounts(width, height, stored)


def planck_in(file: BinaryIO) -> Planck | None:
    """The constants of an open JPEG; None if it tells none. Raises OSError."""
    try:
        block = _block(file)
        at, length = _record(block, _CAMERA)
        record = block[at : at + length]
        order = ">" if unpack("<H", record, 0)[0] >= 0x100 else "<"
        r1, b, f = _numbers(order + "fff", record, _PLANCK)
        o, r2 = _numbers(order + "if", record, _PLANCK_2)
    except StructureError:
        return None
    found = Planck(r1, b, f, o, r2)
    return found if all(map(math.isfinite, (r1, b, f, r2))) and min(r1, b, r2) > 0 else None


def _block(file: BinaryIO) -> bytes:
    """FLIR's file within a JPEG, put together. Raises StructureError if there is none or a part is missing, and OSError."""
    parts: dict[int, bytes] = {}
    last = None
    for content in _segments(file):
        number, last = content[6], content[7] if last is None else last
        parts.setdefault(number, content[_NUMBERED:])
    if last is None or any(number not in parts for number in range(last + 1)):
        raise StructureError("no counts of FLIR's, or not all")
    return b"".join(parts[number] for number in range(last + 1))


def _segments(file: BinaryIO) -> Iterator[bytes]:
    """FLIR's segments in front of a JPEG's data. Raises OSError."""
    at = 2
    for _ in range(MOST_SEGMENTS):
        file.seek(at)
        head = file.read(4 + _NUMBERED)
        if head[:2] == b"\xff\xff":  # a fill byte
            at += 1
            continue
        if len(head) < 4 or head[0] != 0xFF or head[1] in (_START_OF_SCAN, _END):
            return
        length = int.from_bytes(head[2:4], "big")
        if head[1] == _APP1 and head[4:9] == b"FLIR\0" and length > 2 + _NUMBERED:
            yield head[4:] + file.read(length - 2 - _NUMBERED)
        at += 2 + max(length, 2)


def _record(block: bytes, kind: int) -> tuple[int, int]:
    """Where the first record of a kind begins, and its length. Raises StructureError if there is none."""
    if not block.startswith((b"FFF\0", b"AFF\0")):
        raise StructureError("not FLIR's file")
    order = ">" if 100 <= unpack(">I", block, 20)[0] < 200 else "<"  # by the version
    first, count = unpack(order + "II", block, 24)
    for number in range(min(count, _MOST_ENTRIES)):
        found, _, _, _, at, length = unpack(order + "HHIIII", block, first + _ENTRY * number)
        if found == kind:
            return at, length
    raise StructureError("no such record")


def _numbers(form: str, record: bytes, at: int) -> tuple[float, ...]:
    if at + struct.calcsize(form) > len(record):
        raise StructureError("a record that is too short")
    return struct.unpack_from(form, record, at)


def _roughness(counts: Counts) -> float:
    """Mean step between neighbours in deviations."""
    levels = counts.astype(np.float32)
    steps = float(np.abs(np.diff(levels, axis=1)).mean()) if counts.shape[1] > 1 else 0.0
    return steps / max(float(levels.std()), 1e-6)
