"""Common to all painting: types, strips, metres to cv2's drawing coordinates."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from .shapes import Points

Image = NDArray[np.uint8]
Field = NDArray[np.float32]
Grain = NDArray[np.int8]

SHIFT = 4  # fractional bits of cv2's drawing coordinates: 1/16 pixel
STRIP = 256  # rows processed at once: floats of the whole raster would not fit a small machine


def strips(size: int) -> Iterator[slice]:
    for top in range(0, size, STRIP):
        yield slice(top, min(top + STRIP, size))


def fixed(points: Points, gsd: float) -> NDArray[np.int32]:
    """Metres -> cv2's fixed-point pixels; pixel k covers [k, k + 1) * gsd, so its centre is half a pixel in."""
    return np.asarray(np.round((np.asarray(points) / gsd - 0.5) * (1 << SHIFT)), np.int32)


def fixed_length(metres: float, gsd: float) -> int:
    return max(1, round(metres / gsd * (1 << SHIFT)))
