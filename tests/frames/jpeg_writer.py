"""JPEGs that OpenCV cannot write: of four components, with a scan for each, with wrong lengths. Source: ITU-T T.81."""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import NDArray

# Lengths of the codes for differences of 0 to 11 bits, and one code for the end of a block.
_DC_COUNTS = bytes([0, 1, 5, 1, 1, 1, 1, 1, 1, 0, 0, 0, 0, 0, 0, 0])
_AC_COUNTS = bytes([1, *[0] * 15])
_DC_CODES = [(0b00, 2), *((code, 3) for code in range(0b010, 0b111)), *(((1 << n) - 2, n) for n in range(4, 10))]


def segment(marker: int, content: bytes = b"", length: int | None = None) -> bytes:
    """`length` as it is told, if not as it is."""
    return b"\xff" + bytes([marker]) + struct.pack(">H", len(content) + 2 if length is None else length) + content


def of_blocks(
    components: int, columns: int = 20, rows: int = 15, *, interleaved: bool = True, restart: int = 0
) -> bytes:
    """A JPEG of blocks of 8 x 8 equal pixels each, drawn by chance: with four components it is CMYK, as Adobe writes it."""
    levels = np.random.default_rng(components).integers(-60, 60, (rows * columns, components))
    numbers = range(1, components + 1)
    adobe = segment(0xEE, b"Adobe\0\x64\0\0\0\0\0") if components == 4 else b""
    frame = struct.pack(">BHHB", 8, 8 * rows, 8 * columns, components) + b"".join(bytes([n, 0x11, 0]) for n in numbers)
    tables = segment(0xDB, b"\0" + bytes([8] * 64)) + segment(0xC0, frame)
    tables += segment(0xC4, b"\0" + _DC_COUNTS + bytes(range(12))) + segment(0xC4, b"\x10" + _AC_COUNTS + b"\0")
    tables += segment(0xDD, struct.pack(">H", restart)) if restart else b""
    together = [list(numbers)] if interleaved else [[number] for number in numbers]
    scans = [_scan(of, levels[:, [number - 1 for number in of]], restart) for of in together]
    return b"\xff\xd8" + adobe + tables + b"".join(scans) + b"\xff\xd9"


def _scan(numbers: list[int], levels: NDArray[np.int64], restart: int) -> bytes:
    header = bytes([len(numbers)]) + b"".join(bytes([number, 0]) for number in numbers) + bytes([0, 63, 0])
    size = restart or len(levels)
    parts = [_coded(levels[begin : begin + size]) for begin in range(0, len(levels), size)]
    return segment(0xDA, header) + b"".join(
        part + (bytes([0xFF, 0xD0 + number % 8]) if number + 1 < len(parts) else b"")
        for number, part in enumerate(parts)
    )


def _coded(levels: NDArray[np.int64]) -> bytes:
    bits = ""
    for difference in np.diff(levels, axis=0, prepend=0).ravel().tolist():
        size = abs(difference).bit_length()
        code, length = _DC_CODES[size]
        bits += f"{code:0{length}b}"
        bits += f"{difference + ((1 << size) - 1 if difference < 0 else 0):0{size}b}" if size else ""
        bits += "0"  # no more of this block
    bits += "1" * (-len(bits) % 8)
    coded = int(bits, 2).to_bytes(len(bits) // 8, "big")
    return coded.replace(b"\xff", b"\xff\0")
