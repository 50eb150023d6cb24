"""Pictures as they are to be seen: turned as the recording says, with square pixels. Pure."""

from __future__ import annotations

import struct
from dataclasses import dataclass

import cv2
import numpy as np

from gcs_mosaic.stitch.arrays import ImageBGR

MOST_STRETCH = 4.0  # real formats have 8/9 to 64/33


@dataclass(frozen=True, slots=True)
class Orientation:
    """First mirrored left to right, if so, then turned by so many quarters clockwise."""

    quarters: int = 0
    mirrored: bool = False

    def applied(self, image: ImageBGR) -> ImageBGR:
        """(h, w, 3) or, after an odd number of quarters, (w, h, 3)."""
        flipped = image[:, ::-1] if self.mirrored else image
        return np.ascontiguousarray(np.rot90(flipped, -self.quarters))


def of_degrees(clockwise_deg: float) -> Orientation:
    """Of a `rotate` tag."""
    return Orientation(round(clockwise_deg / 90) % 4)


def of_matrix(data: bytes) -> Orientation | None:
    """Of a display matrix as FFmpeg hands it out: nine 32-bit numbers, of which the first, second, fourth and fifth are
    16.16 fixed point: x' = a x + c y, y' = b x + d y with y downwards. None for one that is no such thing."""
    if len(data) < 36:
        return None
    a, b, _, c, d, *_ = struct.unpack("=9i", data[:36])
    if a * d == b * c:
        return None
    mirrored = a * d - b * c < 0
    # Of a mirrored picture the first column is that of the mirrored x axis.
    x, y = (-a, -b) if mirrored else (a, b)
    quarters = (0 if x > 0 else 2) if abs(x) >= abs(y) else (1 if y > 0 else 3)
    return Orientation(quarters, mirrored)


def square_pixels(image: ImageBGR, pixel_aspect: float) -> ImageBGR:
    """`pixel_aspect` is a pixel's width by its height: anamorphic recordings are stretched to what was seen."""
    if not 1 / MOST_STRETCH <= pixel_aspect <= MOST_STRETCH or abs(pixel_aspect - 1) < 0.01:
        return image
    height, width = image.shape[:2]
    size = (round(width * pixel_aspect), height) if pixel_aspect > 1 else (width, round(height / pixel_aspect))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_CUBIC), np.uint8)
