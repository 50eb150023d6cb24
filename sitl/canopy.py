"""Leaves on several levels over the ground, with gaps: what each ray meets first, so that every look sees through other gaps.

Crowns are the same on all levels, clumps of leaves on each its own. How much a level covers is chosen so that a camera straight
above sees a given share of the ground hidden. In the wind crowns sway as in `wind`, the ground stands still.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from .geometry import Array, CameraState, sinking_views
from .ground.noise import fractal
from .ground.raster import Field

SIDE, TEXEL = 2048, 0.1  # texels of the square that is repeated, and metres per texel
CROWN_TEXELS, CLUMP_TEXELS = 64, 8  # the largest crowns and clumps of leaves
CROWN = 0.6  # how much crowns decide where leaves are, beside clumps of deviation 1
LEVELS = 9
HALVINGS = 20
LEAVES = np.array([62, 128, 96], np.float32)  # BGR in the light
SHADE, CONTRAST = 0.55, 0.2  # brightness of the lowest leaves beside the highest, and of clumps, relative
PERIOD = 4.0  # seconds of a stem


@dataclass(frozen=True)
class Canopy:
    """hidden: share of the ground that a camera straight above does not see; lowest, highest: metres of leaves; sway: metres,
    standard deviation of the highest ones."""

    hidden: float
    lowest: float = 4.0
    highest: float = 12.0
    sway: float = 0.2
    seed: int = 1

    @cached_property
    def levels(self) -> tuple[tuple[float, Field], ...]:
        """Height in metres and what covers (SIDE, SIDE), 0 or 1, from the highest down."""
        rng = np.random.default_rng([self.seed, 30])
        crowns = CROWN * fractal(rng, SIDE, coarsest=CROWN_TEXELS, finest=16)
        clumps = [fractal(rng, SIDE, coarsest=CLUMP_TEXELS) + crowns for _ in range(LEVELS)]
        low, high = -5.0, 5.0
        for _ in range(HALVINGS):
            middle = (low + high) / 2
            gaps = np.logical_and.reduce([one <= middle for one in clumps]).mean()
            low, high = (low, middle) if gaps > 1 - self.hidden else (middle, high)
        heights = np.linspace(self.highest, self.lowest, LEVELS).tolist()
        return tuple((height, (one > high).astype(np.float32)) for height, one in zip(heights, clumps, strict=True))

    @cached_property
    def tones(self) -> Field:
        """(SIDE, SIDE) relative brightness of leaves."""
        rng = np.random.default_rng([self.seed, 31])
        return np.asarray(np.maximum(1 + CONTRAST * fractal(rng, SIDE, coarsest=32), 0.2), np.float32)

    def cover(self, light: Field, state: CameraState, rays: Array) -> None:
        """Put leaves before the light (h, w, 3) of the ground, in place."""
        open_still = np.ones(light.shape[:2], np.float32)
        leaves = np.zeros_like(light)
        for number, (height, _) in enumerate(self.levels):
            x, y = self._places(state, rays, number)
            covered = open_still * self._sampled(self.levels[number][1], x, y)
            share = (height - self.lowest) / max(self.highest - self.lowest, 1e-6)
            tone = self._sampled(self.tones, x + 7.3 * number, y) * np.float32(SHADE + (1 - SHADE) * share)
            leaves += (covered * tone)[..., None] * LEAVES
            open_still -= covered
        light *= open_still[..., None]
        light += leaves

    def hides(self, state: CameraState, rays: Array) -> Field:
        """Share of each ray (h, w, 2) that leaves stop."""
        seen = np.ones(rays.shape[:2], np.float32)
        for number, (_, covers) in enumerate(self.levels):
            seen *= 1 - self._sampled(covers, *self._places(state, rays, number))
        return 1 - seen

    def _places(self, state: CameraState, rays: Array, number: int) -> tuple[Field, Field]:
        """East and south in still air of what rays meet on a level, metres."""
        height = self.levels[number][0]
        east, south, down = sinking_views(state, rays)
        drop = (state.height - height) / np.maximum(down, 1e-4)
        x, y = state.x + east * drop, state.y + south * drop
        bent = np.float32(np.sqrt(2) * self.sway * (height / self.highest) ** 2)
        turn = 2 * np.pi * state.time / PERIOD
        gust = np.sin(turn + 0.35 * x), np.sin(0.8 * turn + 0.35 * y)  # a wave over the crowns, some 18 m long
        return np.asarray(x + bent * gust[0], np.float32), np.asarray(y + bent * gust[1], np.float32)

    def _sampled(self, texture: Field, x: Array, y: Array) -> Field:
        column, row = (np.asarray((place / TEXEL) % SIDE, np.float32) for place in (x, y))
        return np.asarray(cv2.remap(texture, column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP), np.float32)
