"""The lowest surface that looks see, by the height at which each small part of a window agrees best.

A plane sweep (R. T. Collins, CVPR 1996): looks are laid on planes at many heights, and each patch is taken to lie at that one at
which they agree most beyond chance. In gaps between crowns that is the ground's, though all of the window together agrees
best at the crowns and the ground is but a shoulder of theirs. Nothing is to be seen below the ground, so that the lower end
of what was found is the ground, or where it is not seen the lowest leaves.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
from scipy.stats import f

from gcs_mosaic.stitch.arrays import Array, FloatImage, Matrix

PATCH = 7  # cells along a side: a gap between crowns is that wide, and narrower patches agree by chance
INDEPENDENT = PATCH * PATCH // 6  # cells beside each other are alike
LEAST_KNOWN = 0.6  # of a patch, seen by enough looks
CHANCE = 1e-7  # that a patch agrees so much at a height by accident: some 100 heights of 400 patches beside each other are tried
LEAST_TOLD = 0.05  # of all patches, that agree beyond chance at some height
LOWEST = 0.005  # of the patches may lie deeper: a few cells are wrong
LEAST_GROUND = 0.015  # of the patches lie at one height where the ground is seen: some five beside each other
DEEPER = 2  # samples of height by which the ground is at most above the deepest patches
MOST = 0.6  # of all patches lie at open ground; at the lowest branches of simulated conifers 0.43 to 0.55 did
DIP = 0.5  # of as many patches as at the ground, between it and what stands over it, where it is told from that


@dataclass(frozen=True, slots=True, eq=False)
class Agreeing:
    """What looks on a plane have in common, and what not, for each cell (h, w): the `common` variance and that `apart`, whose
    degrees of freedom are `free`; 0 where fewer than three looks see it."""

    common: FloatImage
    apart: FloatImage
    free: FloatImage


@dataclass(frozen=True, slots=True)
class LowestSurface:
    """`at`: index of its height; `is_plane`: whether enough of it lies at that one height, and is told from what is above."""

    at: int
    is_plane: bool


def lowest_surface(sweep: list[Agreeing]) -> LowestSurface | None:
    """Of the looks on planes at all heights, the lowest first; None where no patch agrees beyond chance."""
    best = np.zeros(sweep[0].common.shape, np.float32)
    at = np.zeros(best.shape, np.intp)
    for number, one in enumerate(sweep):
        ratio = _beyond_chance(one)
        higher = ratio > best
        best[higher], at[higher] = ratio[higher], number
    found = best >= 1
    total = int(found.sum())
    if total < LEAST_TOLD * found.size:
        return None
    counts = np.bincount(at[found], minlength=len(sweep)).astype(np.float64)
    deepest = int(np.searchsorted(np.cumsum(counts), LOWEST * total, side="right"))
    about = np.convolve(counts, np.ones(3), "same")
    mode = deepest + int(about[deepest : deepest + DEEPER + 1].argmax())
    is_plane = float(about[mode]) >= LEAST_GROUND * total and _is_apart(about, mode, total)
    return LowestSurface(mode if is_plane else deepest, is_plane)


def _is_apart(about: Array, mode: int, total: int) -> bool:
    """Whether fewer lie above a mode before there are more again; if there never are more, whether most of all lie there: of a
    closed wood most is seen of its lowest branches, and ever less above them."""
    more = np.flatnonzero(about[mode + 1 :] > about[mode])
    if not more.size:
        return float(about[mode]) >= MOST * total
    between = about[mode + 1 : mode + 1 + int(more[0])]
    return float(between.min(initial=np.inf)) < DIP * float(about[mode])


def _beyond_chance(one: Agreeing) -> Matrix:
    """F of each patch (h, w), relative to what chance has."""
    looks_but_one = one.free > 0
    common, apart, free, known = (
        cv2.blur(np.asarray(part, np.float32), (PATCH, PATCH))
        for part in (one.common, one.apart, one.free, looks_but_one)
    )
    ratio = (common / np.maximum(known, 1e-6)) / np.maximum(apart / np.maximum(free, 1e-6), 1e-6)
    usual = np.rint(free / np.maximum(known, 1e-6)).astype(np.intp)
    chance = np.array([_by_chance(count) for count in range(int(usual.max(initial=0)) + 1)], np.float32)
    return np.where(known >= LEAST_KNOWN, ratio / chance[usual], 0).astype(np.float32)


@cache
def _by_chance(free: int) -> float:
    """The F that patches of unrelated looks, one more than `free`, hardly ever reach."""
    return float(f.isf(CHANCE, INDEPENDENT, INDEPENDENT * max(free, 1)))
