"""Wind in trees: crowns sway about their stems, each by its own, branches by less, and the ground stands still.

A stem bends like a beam that is fixed in the ground, here with the square of the height. Periods are those of trees of such
heights, some 3 to 6 s (Moore & Maguire, Trees 18, 2004).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from .geometry import Array
from .ground.noise import fractal
from .ground.raster import Field
from .ground.woods import TALLEST, Owners

PERIODS = 3.0, 6.0  # seconds of stems
BRANCHES = 1.3, 1.7  # seconds of branches, east and south
BRANCH_SHARE = 0.4  # how far branches move on their stem, relative to a stem's top
ASIDE = 0.5  # sway across the wind relative to that along it


@dataclass(frozen=True)
class Wind:
    """owner: (n, n) number of the tree, from 1, whose branches reach over a cell of the world."""

    owner: Owners
    seed: int

    def sway(self, time: float) -> Field:
        """(n, n, 2): east and south, how far what is TALLEST high is moved, of standard deviation 1 along the wind."""
        rng = np.random.default_rng([self.seed, 21])
        course, count = rng.uniform(0, 2 * np.pi), int(self.owner.max(initial=0)) + 1
        turns = 2 * np.pi * (time / rng.uniform(*PERIODS, (2, count)) + rng.random((2, count)))
        along, aside = np.sqrt(2) * np.sin(turns) * rng.uniform(0.6, 1.4, count)
        east = along * np.cos(course) - ASIDE * aside * np.sin(course)
        south = along * np.sin(course) + ASIDE * aside * np.cos(course)
        stems = np.stack([east, south], axis=-1).astype(np.float32)[self.owner]
        phases = 2 * np.pi * time / np.array(BRANCHES, np.float32) + self.phases
        return np.asarray(stems + np.float32(BRANCH_SHARE * np.sqrt(2)) * np.sin(phases), np.float32)

    @cached_property
    def phases(self) -> Field:
        """(n, n, 2) radians: branches a few metres apart sway each by its own."""
        rng = np.random.default_rng([self.seed, 22])
        return np.stack([3 * fractal(rng, len(self.owner), coarsest=8, finest=2) for _ in range(2)], axis=-1)


def still_place(sway: Field, x: Array, y: Array, height: Array, column: Field, row: Field) -> tuple[Array, Array]:
    """Where in still air (x, y) is what the wind has moved to (x, y), at these heights, all (h, w).

    sway: (n, n, 2) metres at the height TALLEST; column, row: position in it.
    """
    moved = cv2.remap(sway, column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).reshape(*x.shape, 2)
    bent = (height / TALLEST) ** 2
    return np.asarray(x - moved[..., 0] * bent, x.dtype), np.asarray(y - moved[..., 1] * bent, y.dtype)
