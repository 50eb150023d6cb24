"""Conifers: crowns as cones, each of branches that are dense enough to have a surface, with gaps between the trees.

Of a spruce stand a beam meets 0.3 to 0.5 of a metre of crown in each metre on its way (leaf area density 1 m2/m3, half of it
across the beam, clumped by 0.6 to 1: J. M. Chen, S. G. Leblanc, IEEE Trans. Geosci. Remote Sensing 35(5), 1997), so that what a
camera sees of a crown lies within two or three metres of height, and the ground is seen between trees more than through them.
How wide the crowns are is chosen so that a camera straight above sees a given share of the ground hidden.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from .canopy import CLUMP_TEXELS, HALVINGS, SIDE, TEXEL, Canopy
from .ground.noise import fractal
from .ground.raster import Field

APART = 4.5  # metres between stems, roughly
TALL = 0.7, 1.0  # of the highest leaves: tops of trees
DENSE = 0.35  # of a crown's cross-section that leaves cover on each metre of height
LEAST_RADIUS, MOST_RADIUS = 0.5, 8.0  # metres, of crowns at their lowest branches


@dataclass(frozen=True)
class Conifers(Canopy):
    """As a Canopy; `lowest`: of the lowest branches, metres."""

    @cached_property
    def levels(self) -> tuple[tuple[float, Field], ...]:
        rng = np.random.default_rng([self.seed, 32])
        heights = np.arange(self.highest - 0.5, self.lowest, -1.0).tolist()
        clumps = [fractal(rng, SIDE, coarsest=CLUMP_TEXELS) for _ in heights]
        leaves = [one > np.quantile(one[::8, ::8], 1 - DENSE) for one in clumps]
        trees = self._trees(rng)
        low, high = LEAST_RADIUS, MOST_RADIUS
        for _ in range(HALVINGS // 2):
            middle = (low + high) / 2
            gaps = np.ones((SIDE, SIDE), bool)
            for height, covers in zip(heights, leaves, strict=True):
                gaps &= ~(covers & self._crowns(trees, height, middle))
            low, high = (middle, high) if gaps.mean() > 1 - self.hidden else (low, middle)
        return tuple(
            (height, (covers & self._crowns(trees, height, high)).astype(np.float32))
            for height, covers in zip(heights, leaves, strict=True)
        )

    def _trees(self, rng: np.random.Generator) -> Field:
        """(n, 4): column and row, height of the top in metres, and how much wider than usual."""
        count = int(SIDE * TEXEL / APART)
        middles = np.stack(np.meshgrid(*[(np.arange(count) + 0.5) * SIDE / count] * 2), axis=-1).reshape(-1, 2)
        places = middles + rng.normal(0, 0.25 * APART / TEXEL, middles.shape)
        tops = self.highest * rng.uniform(*TALL, len(places))
        return np.column_stack([places, tops, rng.uniform(0.7, 1.2, len(places))]).astype(np.float32)

    def _crowns(self, trees: Field, height: float, radius: float) -> NDArray[np.bool_]:
        """(SIDE, SIDE) where crowns are at a height, each a cone from its top to the lowest branches."""
        found = np.zeros((SIDE, SIDE), np.uint8)
        for x, y, top, wider in trees.tolist():
            across = wider * radius * (top - height) / (self.highest - self.lowest) / TEXEL
            if across >= 1:
                cv2.circle(found, (round(x), round(y)), round(across), 1, cv2.FILLED)
        return np.asarray(found > 0)
