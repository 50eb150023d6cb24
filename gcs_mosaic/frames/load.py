"""An image file -> pixels, or the reason why not."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.events import Frame
from gcs_mosaic.frames.content import content_hash
from gcs_mosaic.frames.whole import MAX_PIXELS, NotWhole, is_whole

# Colour, eight bits, and the pixels as they were taken: a camera that turns its pictures would change its geometry.
_FLAGS = {
    1: cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION,
    2: cv2.IMREAD_REDUCED_COLOR_2 | cv2.IMREAD_IGNORE_ORIENTATION,
    4: cv2.IMREAD_REDUCED_COLOR_4 | cv2.IMREAD_IGNORE_ORIENTATION,
}


@dataclass(frozen=True, slots=True)
class Unreadable:
    """Why a file gives no picture."""

    reason: str


def load_frame(frame: Frame, max_pixels: int = MAX_PIXELS, reduction: int = 1) -> NDArray[np.uint8] | Unreadable:
    """The frame's pixels as in `decode_image`; Unreadable also if the file is no longer the one that was found."""
    data = _read(frame.path)
    if isinstance(data, Unreadable):
        return data
    if content_hash(data) != frame.content_hash:
        return Unreadable("overwritten since it was found")
    return decode_image(data, max_pixels, reduction)


def load_image(path: Path, max_pixels: int = MAX_PIXELS, reduction: int = 1) -> NDArray[np.uint8] | Unreadable:
    """The pixels of the file at `path` as in `decode_image`."""
    data = _read(path)
    return data if isinstance(data, Unreadable) else decode_image(data, max_pixels, reduction)


def decode_image(data: bytes, max_pixels: int = MAX_PIXELS, reduction: int = 1) -> NDArray[np.uint8] | Unreadable:
    """(height, width, 3) BGR uint8 from a whole JPEG, PNG or TIFF; grey is repeated, 16 bits are scaled down to 8.

    A `reduction` of 2 or 4 gives a picture of half or a quarter of the size (rounded up), which a JPEG is decoded to at once.
    """
    whole = is_whole(data, max_pixels)
    if isinstance(whole, NotWhole):
        return Unreadable(whole.reason)
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), _FLAGS[reduction])
    except cv2.error as error:
        return Unreadable(f"cannot be decoded ({error.err or 'unknown reason'})")
    if image is None:
        return Unreadable("cannot be decoded")
    size = (-(-whole.height // reduction), -(-whole.width // reduction))
    if image.shape != (*size, 3) or image.dtype != np.uint8:
        return Unreadable(f"decodes to {image.shape} {image.dtype}, not to {size[1]} x {size[0]} pixels in colour")
    return np.asarray(image, np.uint8)


def _read(path: Path) -> bytes | Unreadable:
    try:
        return path.read_bytes()
    except OSError as error:
        return Unreadable(f"cannot be read ({error.strerror})")
