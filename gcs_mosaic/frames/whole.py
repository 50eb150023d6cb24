"""Is this image file complete? Answered from its structure, because decoders fill what is missing with grey."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from gcs_mosaic.frames.jpeg import jpeg_size
from gcs_mosaic.frames.png import png_size
from gcs_mosaic.frames.structure import StructureError
from gcs_mosaic.frames.tiff import tiff_size

MAX_PIXELS = 400_000_000  # a larger picture is a trap or a finished map, and would fill the memory of a laptop

_MEASURES: dict[bytes, Callable[[bytes], tuple[int, int]]] = {
    b"\xff\xd8\xff": jpeg_size,
    b"\x89PNG\r\n\x1a\n": png_size,
    b"II*\0": tiff_size,
    b"MM\0*": tiff_size,
    b"II+\0": tiff_size,
    b"MM\0+": tiff_size,
}


@dataclass(frozen=True, slots=True)
class Whole:
    """A complete image of `width` x `height` pixels, as it is stored (no orientation applied)."""

    width: int
    height: int


@dataclass(frozen=True, slots=True)
class NotWhole:
    """Why the bytes are no complete image (yet)."""

    reason: str


def is_whole(data: bytes, max_pixels: int = MAX_PIXELS) -> Whole | NotWhole:
    """Whole if `data` is a complete JPEG, PNG or TIFF of at most `max_pixels`; nothing is decoded."""
    measure = next((measure for magic, measure in _MEASURES.items() if data.startswith(magic)), None)
    if measure is None:
        return NotWhole("not an image (JPEG, PNG or TIFF)" if any(data) else "empty so far")
    try:
        width, height = measure(data)
    except StructureError as truncated:
        return NotWhole(str(truncated))
    if width < 1 or height < 1:
        return NotWhole("an image without pixels")
    if width * height > max_pixels:
        return NotWhole(f"{width} x {height} pixels, more than the limit of {max_pixels / 1e6:g} million")
    return Whole(width, height)


def image_size(data: bytes) -> tuple[int, int] | None:
    """(width, height) in pixels of a whole image; None if it is not one."""
    whole = is_whole(data)
    return (whole.width, whole.height) if isinstance(whole, Whole) else None
