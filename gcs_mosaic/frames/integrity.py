"""What the structure of an image file says of it: its size, and whether it is complete or more may come.

Structure never refuses a file that stands still; it makes us wait. Whether all of it is there is decided by decoding
(`decode`), which looks for missing rows, because decoders fill those with grey.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from gcs_mosaic.frames.jpeg import jpeg_header
from gcs_mosaic.frames.png import png_header
from gcs_mosaic.frames.structure import StructureError, Whole, image_start, other_kind
from gcs_mosaic.frames.tiff import tiff_header

MAX_PIXELS = 400_000_000  # larger ones are decompression bombs or finished maps, and exhaust a laptop's memory

MOST_BANDS = 64  # far more than frame cameras have

_HEADERS: dict[str, Callable[[bytes], Whole]] = {"jpeg": jpeg_header, "png": png_header, "tiff": tiff_header}


@dataclass(frozen=True, slots=True)
class NotWhole:
    """Why the bytes are not a complete image (yet)."""

    reason: str


def is_whole(data: bytes, max_pixels: int = MAX_PIXELS) -> Whole | NotWhole:
    """Whole, with a `doubt` perhaps, if `data` is a JPEG, PNG or TIFF of at most `max_pixels`; nothing is decoded."""
    begin = image_start(data)
    if begin is None:
        return NotWhole(_no_image(data) if data.count(0) < len(data) else "empty")
    try:
        whole = _HEADERS[begin[0]](data)
    except StructureError as truncated:
        return NotWhole(str(truncated))
    if min(whole.width, whole.height, whole.bands) < 1:
        return NotWhole("an image without pixels")
    size = f"{whole.width} x {whole.height} pixels"
    if whole.width * whole.height > max_pixels:
        return NotWhole(f"{size}, more than the limit of {max_pixels / 1e6:g} million")
    # The limit is defined for the memory of 8-bit colour.
    if whole.bands > MOST_BANDS or whole.width * whole.height * whole.bands * whole.bits > 24 * max_pixels:
        limit = f"more than {max_pixels / 1e6:g} million in colour, or than {MOST_BANDS} bands"
        return NotWhole(f"{size} of {whole.bands} bands and {whole.bits} bits: {limit}")
    return whole


def _no_image(data: bytes) -> str:
    kind = other_kind(data)
    return f"not an image (JPEG, PNG or TIFF) but {kind}" if kind else "not an image (JPEG, PNG or TIFF)"


def image_size(data: bytes) -> tuple[int, int] | None:
    """(width, height) in pixels of a complete image; None otherwise."""
    whole = is_whole(data)
    return (whole.width, whole.height) if isinstance(whole, Whole) else None
