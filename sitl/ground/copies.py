"""Identical halls all over the land: every picture contains something that looks the same elsewhere."""

from __future__ import annotations

import cv2
import numpy as np

from .land import lay_out
from .noise import fractal
from .paint import paint
from .raster import Image

HALL = (24.0, 16.0)  # metres along and across
APART = 62.0  # metres between centres: about one in every picture taken from 60 m, never two
MAKE = 4  # seed of the halls' appearance, independent of the land
ROOF = (118, 122, 130)  # BGR


def paint_copies(seed: int, size: int, gsd: float) -> Image:
    """-> (size, size, 3) BGR: the countryside of this seed with the same hall on a jittered lattice."""
    picture = paint(lay_out(seed, size * gsd), seed, size, gsd)
    hall = one_hall(gsd)
    height, width = hall.shape[:2]
    rng = np.random.default_rng([seed, 8])
    step = APART / gsd
    for top in np.arange(step / 3, size - height - step / 4, step):
        for left in np.arange(step / 3, size - width - step / 4, step):
            y, x = (int(start + rng.uniform(-0.15, 0.15) * step) for start in (top, left))
            picture[y : y + height, x : x + width] = hall
    return picture


def one_hall(gsd: float) -> Image:
    """A roof with patches, stains, skylights and vents, so that it has features at every scale."""
    rng = np.random.default_rng([MAKE, 9])
    width, height = (round(side / gsd) for side in HALL)
    stains = fractal(rng, 512, coarsest=64)[:height, :width]
    light = 1 + 0.16 * stains
    roof = np.clip(np.asarray(ROOF, np.float32) * light[..., None], 0, 255).astype(np.uint8)
    for _ in range(40):
        x, y, tone = rng.integers(width), rng.integers(height), int(rng.integers(40, 220))
        a, b = rng.integers(2, 14, 2)
        cv2.rectangle(roof, (int(x), int(y)), (int(x + a), int(y + b)), (tone, tone, tone), -1, cv2.LINE_AA)
    cv2.line(roof, (0, height // 2), (width, height // 2), (70, 72, 76), 3)
    return roof
