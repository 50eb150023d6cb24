"""The ground's height beneath trees, sought by itself: at which heights the looks agree.

Where something lies at a height, all looks that see it show the same there, and the mean of them keeps its contrast; elsewhere
they show unrelated things, and the mean has what is left of unrelated things: the variance of one look over their number. The
ratio of the two is the F of an analysis of variance, 1 where nothing is in focus. (Visibility over heights by grey level
variance: I. Kurmi, D. C. Schedl, O. Bimber, IEEE Geoscience and Remote Sensing Letters 18(4), 2021.) Of the heights at which
the looks agree the lowest is the ground, for nothing is to be seen below it. It is known only if it is one height: crowns agree
over many, and then the ground is somewhere at their lower end or below.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from gcs_mosaic.integral.aperture import SyntheticAperture
from gcs_mosaic.integral.depth_sweep import DEEPER, Agreeing, LowestSurface, lowest_surface
from gcs_mosaic.integral.flight_looks import HIGHEST, LOWEST, spread
from gcs_mosaic.integral.stack import GroundLook, GroundWindow, LookStack, laid_together
from gcs_mosaic.stitch.arrays import Array, FloatImage, Mask

CELLS = 72  # of the window's side while it is sought: details of half a metre in 40 m
MOST_LOOKS = 16  # more of them hardly make it surer, and cost
BROAD = 11  # cells; what is broader is in focus over too many heights to tell one
MOST_HEIGHTS = 108  # one for each 1.5 % of the way from the camera
# Agreement by chance: of some thousand pixels the ratio is 1 within 0.05; 0.25 is far beyond, also where neighbours are alike.
LEAST_AGREEMENT = 1.25
# Of the deviation of all heights, most of which show unrelated things: crowns that stand in rows, or as far apart as the looks,
# agree a little at wrong heights, by chance.
LEAST_OVER_RIPPLES = 6.0
# A peak is one if between it and each higher one the looks agree so much less: other ratios are ripples of the same peak.
LEAST_DIP = 0.93
# Beside the height of best agreement; beneath a layer that hides 80 % it is 2 %.
LEAST_SHARE = 0.015
# Heights over which what lies at one height is in focus, in those at which a point moves by a cell over the aperture: half of the
# agreement was left at 5 to 8 of them over fields and gardens, and 20 over crowns of many heights.
MOST_BREADTH = 11.0
AGREES = 1.5  # where crowns begin: more than half as much again as by chance
LEAST_BREADTH = 3.0  # samples: a peak and its neighbours
LEAST_LOOKS = 3  # two always agree somewhere


@dataclass(frozen=True, slots=True, kw_only=True)
class Focus:
    """`height`: share of the flying height above the map's ground; `known`: whether looks agree there, and not at
    all heights about it as crowns do; `agreement`: how much more than by chance, 1; `heights`, `curve`: all that were tried, and
    how much looks agree there. `beside`: it is not known here, and the height is that of the ground found around it."""

    height: float
    known: bool
    agreement: float
    heights: Array
    curve: Array
    beside: bool = False
    guess: float | None = None  # where it is not known here: the lower end of what agrees

    @property
    def is_guess(self) -> bool:
        """Whether nothing tells where the ground is."""
        return not self.known and not self.beside


def ground_focus(
    looks: Sequence[GroundLook], window: GroundWindow, flying_height: float, aperture: SyntheticAperture
) -> Focus:
    """Seek it about a window's middle. Where it is not known: the lower end of what agrees; the map's ground if nothing does."""
    coarse = GroundWindow(window.x, window.y, window.side, min(CELLS, window.cells))
    some = [_coarser(one, coarse.cell / window.cell) for one in spread(looks, MOST_LOOKS)]
    heights = _heights(coarse, aperture)
    if len(some) < LEAST_LOOKS:
        return Focus(height=0.0, known=False, agreement=1.0, heights=heights, curve=np.ones(len(heights)), guess=0.0)
    sweep = [agreeing(laid_together(some, coarse, share * flying_height)) for share in heights]
    curve = np.array([ratio_of(one) for one in sweep])
    apart = math.log((1 - heights[0]) / (1 - heights[1]))
    broadest = MOST_BREADTH * coarse.cell / max(aperture.width, 1e-9) / apart
    at, is_known = _lowest(curve, broadest, lowest_surface(sweep) if curve.max() >= LEAST_AGREEMENT else None)
    height = _between(heights, curve, at) if is_known else float(heights[at])
    if not is_known and curve[at] < AGREES and float(curve.max()) < AGREES:
        height = 0.0
    told, guess = (float(curve[at]), None) if is_known else (float(curve.max()), height)
    return Focus(height=height, known=is_known, agreement=told, heights=heights, curve=curve, guess=guess)


def _lowest(curve: Array, broadest: float, surface: LowestSurface | None) -> tuple[int, bool]:
    """Index of the ground's height, and whether it is known. All of the window together tells of ground that many small gaps
    show; patches by themselves tell of ground between crowns, where together crowns outweigh it."""
    peak = next(iter(_peaks(curve, broadest)), None)
    if surface is None:
        agreeing_at = np.flatnonzero(curve >= AGREES)
        return (int(agreeing_at[0]) if agreeing_at.size else 0, False) if peak is None else (peak, True)
    if peak is not None and peak <= surface.at + DEEPER:
        return peak, surface.is_plane or peak < int(curve.argmax())  # the best one may be of crowns
    return surface.at, surface.is_plane


def _coarser(look: GroundLook, factor: float) -> GroundLook:
    """With as few pixels as the window has: fewer to be read, and none between them is passed over."""
    times = int(factor)
    rows, columns = (size // times for size in look.image.shape[:2])
    if times < 2 or min(rows, columns) < 2:
        return look
    whole = look.image[: rows * times, : columns * times].mean(axis=2)
    small = cv2.resize(whole, (columns, rows), interpolation=cv2.INTER_AREA)
    return replace(look, image=np.asarray(small[..., None], np.float32), reduction=look.reduction * times)


def agreement(stack: LookStack) -> float:
    """F of the looks of a stack: 1 if they show unrelated things, more where they show the same; 1 of fewer than three."""
    return ratio_of(agreeing(stack))


def ratio_of(found: Agreeing) -> float:
    """F of a whole window; 1 where too few looks see any of it."""
    known = int((found.free > 0).sum())
    if not known:
        return 1.0
    within = float(found.apart.sum() / found.free.sum())
    return float(found.common.sum() / known) / max(within, 1e-9)


def agreeing(stack: LookStack) -> Agreeing:
    """The analysis of variance of looks, cell by cell."""
    if not len(stack.values):
        nothing = np.zeros(stack.values.shape[1:3], np.float32)
        return Agreeing(nothing, nothing, nothing)
    grey = np.stack([_details(one) for one in stack.values])
    seen = np.isfinite(grey)
    count = seen.sum(axis=0)
    known = count >= LEAST_LOOKS
    values = np.where(seen, grey, 0)
    middle = values.sum(axis=0) / np.maximum(count, 1)
    apart = (np.where(seen, values - middle, 0) ** 2).sum(axis=0)
    of_cells = (count * middle**2, apart, count - 1)
    return Agreeing(*(np.where(known, one, 0).astype(np.float32) for one in of_cells))


def _details(look: FloatImage) -> FloatImage:
    """What of a look (h, w, bands) is neither broad nor of its own light, in its own deviations (h, w)."""
    grey = look.mean(axis=2)
    known = np.isfinite(grey)
    filled = np.where(known, grey, 0).astype(np.float32)
    weight = cv2.blur(known.astype(np.float32), (BROAD, BROAD))
    apart = grey - cv2.blur(filled, (BROAD, BROAD)) / np.maximum(weight, 1e-6)
    some = apart[known]
    # A hot spot alone does not make a look's deviation: what is far out is cut.
    scale = 1.4826 * float(np.median(np.abs(some))) if some.size else 0.0
    return np.asarray(np.clip(apart / max(scale, 1e-3), -5, 5), np.float32)


def _heights(window: GroundWindow, aperture: SyntheticAperture) -> Array:
    """So close that between two a point at the window's middle moves by a pixel or two over the aperture: the farther from the
    camera, the farther apart, by equal ratios."""
    farthest, nearest = math.log(1 - LOWEST), math.log(1 - HIGHEST)
    moved = aperture.width / max(window.cell, 1e-9) * (farthest - nearest)
    return 1 - np.exp(np.linspace(farthest, nearest, int(np.clip(moved, 9, MOST_HEIGHTS))))


def _peaks(curve: Array, broadest: float) -> list[int]:
    """Those that stand out from what is between them and any higher one, the lowest first, if they are no chance and not broader
    than so many samples; none if the height of best agreement is: then it is of crowns."""
    best = int(curve.argmax())
    ripples = 1.4826 * float(np.median(np.abs(curve - np.median(curve))))
    least = max(LEAST_AGREEMENT, 1 + LEAST_SHARE * (float(curve[best]) - 1), 1 + LEAST_OVER_RIPPLES * ripples)
    if _breadth(curve, best) > max(broadest, LEAST_BREADTH):
        return []
    found = list[int]()
    for at, value in enumerate(curve):
        below, above = _least_to_higher(curve[:at][::-1], value), _least_to_higher(curve[at + 1 :], value)
        stands_out = value >= least and max(below, above) < LEAST_DIP * value
        if stands_out and _breadth(curve, at) <= max(broadest, LEAST_BREADTH):
            found.append(at)
    return found


def _breadth(curve: Array, at: int) -> int:
    """Samples about a peak where looks agree half as much beyond chance, or more."""
    lower: Mask = curve < 1 + (curve[at] - 1) / 2
    before, after = np.flatnonzero(lower[:at]), np.flatnonzero(lower[at:])
    first = int(before[-1]) + 1 if before.size else 0
    return (at + int(after[0]) if after.size else len(curve)) - first


def _least_to_higher(curve: Array, value: float) -> float:
    """The least of a curve before it is higher than a value; at its end nothing holds it."""
    higher: Mask = curve > value
    reach = int(higher.argmax()) if higher.any() else len(curve)
    return float(curve[:reach].min(initial=value)) if reach else value


def _between(heights: Array, curve: Array, at: int) -> float:
    """Top of the parabola through a peak and its neighbours."""
    if not 0 < at < len(curve) - 1:
        return float(heights[at])
    before, here, after = curve[at - 1 : at + 2]
    bend = before - 2 * here + after
    shift = 0.0 if bend >= 0 else float(np.clip(0.5 * (before - after) / bend, -0.5, 0.5))
    return float(heights[at] + shift * (heights[at + 1] - heights[at - 1]) / 2)
