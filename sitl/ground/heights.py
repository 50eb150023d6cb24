"""Height maps of the ground and of the objects on it."""

from __future__ import annotations

import cv2
import numpy as np

from .raster import SHIFT, Field, fixed, fixed_length
from .shapes import Land

CELL = 4  # raster pixels per cell of the height map
HIGHEST_HILL = 5.0  # metres: a twentieth of the default flying height
HIGHEST_SINGLE, HILL_RADIUS = 25.0, 80.0  # metres: a quarter of it; one standard deviation of its bell


def height_map(seed: int, land: Land, size: int, gsd: float) -> Field:
    """(size / CELL, size / CELL) metres: hills with buildings and trees; walls are one cell wide."""
    cells, cell = size // CELL, gsd * CELL
    return np.asarray(hills(np.random.default_rng([seed, 3]), cells, cell) + standing(land, size, gsd), np.float32)


def single_hill(size: int, gsd: float) -> Field:
    """(size / CELL, size / CELL) metres: one bare hill in the middle, 2.4 times as wide as high above it is flown."""
    cells = size // CELL
    off = (np.mgrid[0:cells, 0:cells].astype(np.float32) - (cells - 1) / 2) * np.float32(gsd * CELL / HILL_RADIUS)
    return np.asarray(HIGHEST_SINGLE * np.exp(-(off**2).sum(axis=0) / 2), np.float32)


def standing(land: Land, size: int, gsd: float) -> Field:
    """(size / CELL, size / CELL) metres: heights of buildings and trees above the ground."""
    cells, cell = size // CELL, gsd * CELL
    objects = np.zeros((cells, cells), np.float32)
    for building in land.buildings:
        cv2.fillConvexPoly(objects, fixed(building.outline()[0], cell), building.height, cv2.LINE_8, SHIFT)
    for share, high in ((1.0, 0.55), (0.75, 0.85), (0.45, 1.0)):
        for tree in land.trees:
            x, y = fixed(np.array([tree.x, tree.y]), cell).tolist()
            cv2.circle(
                objects, (x, y), fixed_length(tree.radius * share, cell), tree.height * high, -1, cv2.LINE_8, SHIFT
            )
    return np.asarray(cv2.blur(objects, (3, 3)), np.float32)


def hills(rng: np.random.Generator, cells: int, cell: float) -> Field:
    """Sine waves of 80 to 400 m wavelength, from 0 to HIGHEST_HILL."""
    y, x = np.mgrid[0:cells, 0:cells].astype(np.float32) * np.float32(cell)
    waves = np.zeros((cells, cells), np.float32)
    for length in (400.0, 240.0, 140.0, 80.0):
        turn, phase = rng.uniform(0, 2 * np.pi, 2).astype(np.float32)
        waves += length * np.sin((x * np.cos(turn) + y * np.sin(turn)) * np.float32(2 * np.pi / length) + phase)
    waves -= waves.min()
    return np.asarray(waves * (HIGHEST_HILL / waves.max()), np.float32)
