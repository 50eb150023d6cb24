"""FLIR's radiometric JPEGs, as its cameras write them. Source: ExifTool's documentation of FLIR's tags (FFF)."""

from __future__ import annotations

import struct
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from tests.frames.jpeg_writer import segment

# Of a Vue Pro R, as ExifTool prints them: R1, B, F, O, R2.
PLANCK = 17096.453, 1428.0, 1.0, -342, 0.046642166
PART = 65_524  # bytes of FLIR's file in a segment, at most
ENTRIES = 14  # of the directory; those that are not used are zero


def radiometric(
    jpeg: bytes, counts: NDArray[np.uint16], *, png: bool = False, order: str = "<", parts: Sequence[int] | None = None
) -> bytes:
    """A JPEG with counts (h, w) beside it; `order`: of the raw rows, PNGs are always the wrong way round. `parts`: which of
    FLIR's segments are written, in which order."""
    contents = numbered(flir_file(counts, png=png, order=order))
    chosen = contents if parts is None else [contents[k] for k in parts if k < len(contents)]
    return jpeg[:2] + b"".join(segment(0xE1, one) for one in chosen) + jpeg[2:]


def numbered(block: bytes, size: int = PART) -> list[bytes]:
    """The contents of segments that bear a block."""
    pieces = [block[at : at + size] for at in range(0, len(block), size)]
    return [b"FLIR\0\1" + bytes([number, len(pieces) - 1]) + piece for number, piece in enumerate(pieces)]


def flir_file(counts: NDArray[np.uint16], *, png: bool = False, order: str = "<") -> bytes:
    """With two records: the counts, and the camera's constants."""
    records = [(1, raw_record(counts, png=png, order=order)), (32, camera_record())]
    at, entries = 64 + 32 * ENTRIES, b""
    for kind, record in records:
        entries += struct.pack(">HHIIII", kind, 1, 100, 1, at, len(record)) + bytes(12)
        at += len(record)
    head = b"FFF\0" + b"MTX IR".ljust(16, b"\0") + struct.pack(">III", 100, 64, ENTRIES)
    return head.ljust(64, b"\0") + entries.ljust(32 * ENTRIES, b"\0") + b"".join(record for _, record in records)


def raw_record(counts: NDArray[np.uint16], *, png: bool, order: str) -> bytes:
    height, width = counts.shape
    head = struct.pack("<HHH", 2, width, height).ljust(32, b"\0")
    if not png:
        return head + counts.astype(order + "u2").tobytes()
    done, data = cv2.imencode(".png", counts.byteswap())
    assert done
    return head + data.tobytes()


def camera_record() -> bytes:
    record = bytearray(900)
    struct.pack_into("<H", record, 0, 2)
    # Emissivity, distance, temperatures of what is reflected, of the air and of the window, and what passes that.
    struct.pack_into("<6f", record, 32, 1.0, 0.0, 293.15, 293.15, 293.15, 1.0)
    struct.pack_into("<fff", record, 88, *PLANCK[:3])
    struct.pack_into("<if", record, 776, *PLANCK[3:])
    return bytes(record)
