"""Open water: waves of a few lengths in nearly one direction, with sunlit crests.

Waves move: two pictures of one place show different waves, as two seeds do.
"""

from __future__ import annotations

import numpy as np

from .noise import fractal
from .raster import Image, strips

LENGTHS = (0.9, 1.3, 1.9, 3.1, 5.3, 9.1)  # wavelengths in metres
SPREAD = 0.5  # radians; standard deviation of the wave directions around the wind's
CALM = (96, 84, 58)  # BGR
GLINT = 1.9  # wave height above which a crest glints


def paint_water(seed: int, size: int, gsd: float) -> Image:
    """-> (size, size, 3) BGR."""
    rng = np.random.default_rng([seed, 7])
    wind = rng.uniform(0, 2 * np.pi)
    waves = [(length, wind + rng.normal(0, SPREAD), rng.uniform(0, 2 * np.pi)) for length in LENGTHS for _ in range(3)]
    breath = fractal(rng, size, coarsest=128, finest=2)
    picture = np.empty((size, size, 3), np.uint8)
    x = np.arange(size, dtype=np.float32)[None] * np.float32(gsd)
    for rows in strips(size):
        y = np.arange(rows.start, rows.stop, dtype=np.float32)[:, None] * np.float32(gsd)
        height = 0.5 * breath[rows]
        for length, course, phase in waves:
            distance = x * np.float32(np.cos(course)) + y * np.float32(np.sin(course))
            height += 0.3 * np.sin(distance * np.float32(2 * np.pi / length) + np.float32(phase))
        light = 1 + 0.12 * height + 1.2 * np.clip(height - GLINT, 0, 1)
        picture[rows] = np.clip(np.asarray(CALM, np.float32) * light[..., None], 0, 255)
    return picture
