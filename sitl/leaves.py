"""Leaves on all sides of a crown: a texture in space, for the picture from above has one colour for all of a steep side."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np

from .geometry import Array
from .ground.noise import fractal
from .ground.raster import Field

SIDE, TEXEL = 1024, 0.1  # texels of the square that is repeated, and metres per texel
LARGEST = 16  # texels of the largest clumps
RISE = (
    1.3,
    0.9,
)  # texture is sheared by so much per metre of height, east and south: what lies above another is different
CONTRAST = 0.3  # relative brightness per standard deviation


def leaf_out(colours: Field, place: tuple[Array, Array, Array], lowest: float, octave: float) -> None:
    """Multiply the light (h, w, 3) by that of leaves where the surface seen, (x, y, height) in still air, is above `lowest`, in
    place. octave: log2 of the texels that a pixel covers."""
    x, y, height = place
    levels = clumps()
    level = int(np.clip(round(octave), 0, len(levels) - 1))
    texel = TEXEL * 2**level
    column, row = (
        (np.nan_to_num((at + rise * height) / texel) % len(levels[level])).astype(np.float32)
        for at, rise in ((x, RISE[0]), (y, RISE[1]))
    )
    noise = cv2.remap(levels[level], column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
    colours *= np.where(height > lowest, np.maximum(1 + CONTRAST * noise, 0.2), 1)[..., None].astype(np.float32)


@lru_cache(maxsize=1)
def clumps() -> tuple[Field, ...]:
    """Noise of deviation 1, (SIDE, SIDE) and each half the size of the one before."""
    levels = [fractal(np.random.default_rng(24), SIDE, coarsest=LARGEST)]
    while len(levels[-1]) > LARGEST:
        half = len(levels[-1]) // 2
        levels.append(np.asarray(cv2.resize(levels[-1], (half, half), interpolation=cv2.INTER_AREA), np.float32))
    return tuple(levels)
