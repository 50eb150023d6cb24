"""Paints an orthographic view of a countryside, one pixel per `gsd` metres.

Painted from the ground up: soil and crops, roads, their shadows, roofs and crowns, then grain over all.
"""

from __future__ import annotations

import cv2
import numpy as np

from .noise import fractal
from .objects import dim, draw_asphalt, draw_crowns, draw_roof, draw_shadows
from .raster import Grain, Image, strips
from .shapes import Land
from .soil import paint_soil

GRAIN_UNIT = 20  # one standard deviation of the grain as stored (int8)
GRAIN_STRENGTH = 0.13  # relative brightness per standard deviation


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
    """Noise at every scale, with scattered stones and tufts: distinctive features at every flying height."""
    noise = fractal(rng, size, coarsest=128)
    marks = strew(rng, size, gsd)
    grain = np.empty((size, size), np.int8)
    for rows in strips(size):
        grain[rows] = np.clip(noise[rows] * GRAIN_UNIT + marks[rows] - 128.0, -127, 127)
    return grain


def strew(rng: np.random.Generator, size: int, gsd: float) -> Image:
    """(size, size) around 128: one mark of 0.1 to 0.9 m per five square metres, dark or bright."""
    marks = np.full((size, size), 128, np.uint8)
    count = int((size * gsd) ** 2 / 5)
    places, light = rng.integers(0, size, (count, 2)), 128 + rng.normal(0, 34, count)
    axes = np.clip(rng.gamma(1.3, 0.12, (count, 2)) / gsd, 0.5, 0.45 / gsd).round().astype(int)
    for (x, y), (a, b), value in zip(places.tolist(), axes.tolist(), light.tolist(), strict=True):
        cv2.ellipse(marks, (x, y), (a, b), 137.5 * (x % 8), 0, 360, min(255, max(0, value)), -1)
    return np.asarray(cv2.GaussianBlur(marks, (3, 3), 0.7), np.uint8)


def weather(picture: Image, grain: Grain) -> None:
    """Multiply the picture by the grain, in place."""
    for rows in strips(len(picture)):
        light = 1 + grain[rows].astype(np.float32)[..., None] * (GRAIN_STRENGTH / GRAIN_UNIT)
        picture[rows] = np.clip(picture[rows] * light, 0, 255).astype(np.uint8)
