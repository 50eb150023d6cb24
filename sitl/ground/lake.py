"""A lake: land in the west, water in the east, and a few islets.

The water is painted in its plain colour; waves and glint are added when a frame is rendered (glint.py).
"""

from __future__ import annotations

import cv2
import numpy as np

from .land import lay_out
from .noise import fractal
from .paint import paint
from .raster import Field, Image
from .water import CALM

SHORE = 0.12  # amplitude of the shoreline, as a share of the side
ISLETS = 3


def paint_lake(seed: int, size: int, gsd: float) -> tuple[Image, Field]:
    """Picture (size, size, 3) BGR, and the share of water (size, size), 0 to 1."""
    picture = paint(lay_out(seed, size * gsd), seed, size, gsd)
    water = water_of(seed, size)
    for channel, calm in enumerate(CALM):
        band = picture[..., channel]
        band[:] = np.clip(band + water * (calm - band.astype(np.float32)), 0, 255)
    return picture, water


def water_of(seed: int, size: int) -> Field:
    rng = np.random.default_rng([seed, 15])
    bays = fractal(rng, size, coarsest=512, finest=32)
    east = np.linspace(-1, 1, size, dtype=np.float32)[None]
    depth = east + SHORE * bays
    y, x = np.mgrid[0:size, 0:size].astype(np.float32) / np.float32(size)
    for centre_x, centre_y in rng.uniform((0.6, 0.1), (0.95, 0.9), (ISLETS, 2)).astype(np.float32):
        depth = np.minimum(depth, 14 * np.hypot(x - centre_x, y - centre_y) - 0.35 + 0.3 * SHORE * bays)
    return np.asarray(cv2.blur(np.clip(depth * size / 24, 0, 1), (3, 3)), np.float32)
