"""JPEG's segments that decoding needs: what each says, and whether bytes can be one. Source: ITU-T T.81, annex B."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from gcs_mosaic.frames.structure import unpack

FRAMES = set(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}  # SOFn
SEQUENTIAL = {0xC0, 0xC1}  # with Huffman's codes, like nearly all
PROGRESSIVE = {0xC2, 0xC6, 0xCA, 0xCE}
_LOSSLESS, _HIERARCHICAL, _ARITHMETIC = {0xC3, 0xCB}, {0xC5, 0xC6, 0xC7, 0xCD, 0xCE, 0xCF}, {0xC9, 0xCA}
_HUFFMAN, _QUANTISATION, _RESTART = 0xC4, 0xDB, 0xDD


@dataclass(frozen=True, slots=True)
class JpegFrame:
    """A frame header: `components` are their numbers, `unit` is (w, h) in pixels of what is coded together (an MCU)."""

    marker: int
    width: int
    height: int
    bits: int
    components: tuple[int, ...]
    unit: tuple[int, int]

    @property
    def is_progressive(self) -> bool:
        """Whether it comes in scans of which each refines the whole picture."""
        return self.marker in PROGRESSIVE

    @property
    def unusual(self) -> str:
        """What keeps common decoders from reading it, empty if nothing is known."""
        if self.marker in _LOSSLESS:
            return "a lossless JPEG"
        if self.marker in _HIERARCHICAL:
            return "a hierarchical JPEG"
        if self.marker in _ARITHMETIC:
            return "a JPEG with arithmetic coding"
        return "" if self.bits == 8 else f"a JPEG of {self.bits} bits"


@dataclass(frozen=True, slots=True)
class JpegScan:
    """A scan header: which coefficients (`first` to `last`) of which components it brings, up to which bit."""

    components: tuple[int, ...]
    first: int
    last: int
    last_bit: int


def frame_of(data: bytes, content: int, end: int, marker: int) -> JpegFrame | None:
    """The frame header of a segment's content, from its length on; None if it is none."""
    if end - content < 11:
        return None
    _, bits, height, width, count = unpack(">HBHHB", data, content)
    if not 0 < count <= 4 or end - content != 8 + 3 * count:
        return None
    each = unpack(f">{3 * count}B", data, content + 8)
    across, down = max(value >> 4 for value in each[1::3]), max(value & 15 for value in each[1::3])
    return JpegFrame(marker, width, height, bits, tuple(each[::3]), (8 * max(across, 1), 8 * max(down, 1)))


def scan_of(data: bytes, content: int, end: int, frame: JpegFrame) -> JpegScan | None:
    """The scan header of a segment's content; None if it is none of this frame's."""
    if end - content < 8:
        return None
    count = data[content + 2]
    if not 0 < count <= 4 or end - content != 6 + 2 * count:
        return None
    components = tuple(data[content + 3 : content + 3 + 2 * count : 2])
    first, last, bits = unpack(">BBB", data, end - 3)
    return JpegScan(components, first, min(last, 63), bits & 15) if set(components) <= set(frame.components) else None


def is_table(data: bytes, content: int, end: int, marker: int) -> bool:
    """Whether a segment's content is made of whole tables."""
    at = content + 2
    if marker == _RESTART:
        return end - content == 4
    if marker not in (_HUFFMAN, _QUANTISATION):
        return (end - at) % 2 == 0
    while at < end:
        at += _huffman_bytes(data, at) if marker == _HUFFMAN else 65 + 64 * (data[at] >> 4)
    return at == end


def _huffman_bytes(data: bytes, at: int) -> int:
    return 17 + sum(data[at + 1 : at + 17])


def is_refined(frame: JpegFrame, scans: Sequence[JpegScan]) -> bool:
    """Whether a progressive picture's scans bring every coefficient of every component to its last bit."""
    done = dict.fromkeys(frame.components, 0)
    for scan in scans:
        if scan.last_bit == 0 and scan.last >= scan.first:
            for component in scan.components:
                done[component] |= (2 << scan.last) - (1 << scan.first)
    return all(coefficients == (1 << 64) - 1 for coefficients in done.values())
