"""Paints a countryside as seen from straight above, one pixel per `gsd` metres.

The order is nature's: soil and crops, roads, shadows on them, then roofs and crowns that stand above, grain over all.
"""

from __future__ import annotations

import cv2
import numpy as np

from .noise import fractal
from .objects import dim, draw_asphalt, draw_crowns, draw_roof, draw_shadows
from .raster import Grain, Image, strips
from .shapes import Land
from .soil import paint_soil

GRAIN_UNIT = 20  # one deviation of the grain as stored
GRAIN_STRENGTH = 0.13  # share of the light that one deviation takes or gives


def paint(land: Land, seed: int, size: int, gsd: float) -> Image:
    """-> (size, size, 3) BGR."""
    rng = np.random.default_rng([seed, 2])
    grain = strewn_grain(rng, size, gsd)
    patches = fractal(rng, size // 4, coarsest=256, finest=4)
    picture = paint_soil(land, grain, patches, gsd)
    draw_asphalt(picture, land.ways, gsd)
    dim(picture, draw_shadows(land, size, gsd))
    for building in land.buildings:
        draw_roof(picture, building, gsd)
    draw_crowns(rng, picture, land.trees, gsd)
    weather(picture, grain)
    return picture


def strewn_grain(rng: np.random.Generator, size: int, gsd: float) -> Grain:
    """Noise of every scale, with stones and tufts strewn in: marks that can be told apart at every flying height."""
    noise = fractal(rng, size, coarsest=128)
    marks = strew(rng, size, gsd)
    grain = np.empty((size, size), np.int8)
    for rows in strips(size):
        grain[rows] = np.clip(noise[rows] * GRAIN_UNIT + marks[rows] - 128.0, -127, 127)
    return grain


def strew(rng: np.random.Generator, size: int, gsd: float) -> Image:
    """(size, size) around 128: one mark of 0.1 to 0.9 m on every five square metres, dark or bright."""
    marks = np.full((size, size), 128, np.uint8)
    count = int((size * gsd) ** 2 / 5)
    places, light = rng.integers(0, size, (count, 2)), 128 + rng.normal(0, 34, count)
    axes = np.clip(rng.gamma(1.3, 0.12, (count, 2)) / gsd, 0.5, 0.45 / gsd).round().astype(int)
    for (x, y), (a, b), value in zip(places.tolist(), axes.tolist(), light.tolist(), strict=True):
        cv2.ellipse(marks, (x, y), (a, b), 137.5 * (x % 8), 0, 360, min(255, max(0, value)), -1)
    return np.asarray(cv2.GaussianBlur(marks, (3, 3), 0.7), np.uint8)


def weather(picture: Image, grain: Grain) -> None:
    """Multiply the grain into everything, in place."""
    for rows in strips(len(picture)):
        light = 1 + grain[rows].astype(np.float32)[..., None] * (GRAIN_STRENGTH / GRAIN_UNIT)
        picture[rows] = np.clip(picture[rows] * light, 0, 255).astype(np.uint8)
