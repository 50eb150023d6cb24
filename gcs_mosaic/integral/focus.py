"""The ground's height beneath trees, sought by itself: at which heights the looks agree.

Where something lies at a height, all looks that see it show the same there, and the mean of them keeps its contrast; elsewhere
they show unrelated things, and the mean has what is left of unrelated things: the variance of one look over their number. The
ratio of the two is the F of an analysis of variance, 1 where nothing is in focus. (Visibility over heights by grey level
variance: I. Kurmi, D. C. Schedl, O. Bimber, IEEE Geoscience and Remote Sensing Letters 18(4), 2021.) Of the heights at which
the looks agree the lowest is the ground, for nothing is to be seen below it. It is known only if it is one height: crowns agree
over many, and then the ground is somewhere at their lower end or below.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from gcs_mosaic.integral.aperture import SyntheticAperture
from gcs_mosaic.integral.flight_looks import HIGHEST, LOWEST, spread
from gcs_mosaic.integral.stack import GroundLook, GroundWindow, LookStack, laid_together
from gcs_mosaic.stitch.arrays import Array, FloatImage, Mask

CELLS = 72  # of the window's side while it is sought: details of half a metre in 40 m
MOST_LOOKS = 16  # more of them hardly make it surer, and cost
BROAD = 11  # cells; what is broader is in focus over too many heights to tell one
MOST_HEIGHTS = 61  # one for each 1.5 % of the flying height
# Agreement by chance: of some thousand pixels the ratio is 1 within 0.05; 0.25 is far beyond, also where neighbours are alike.
LEAST_AGREEMENT = 1.25
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
    how much looks agree there."""

    height: float
    known: bool
    agreement: float
    heights: Array
    curve: Array


def ground_focus(
    looks: Sequence[GroundLook], window: GroundWindow, flying_height: float, aperture: SyntheticAperture
) -> Focus:
    """Seek it about a window's middle. Where it is not known: the lower end of what agrees; the map's ground if nothing does."""
    coarse = GroundWindow(window.x, window.y, window.side, min(CELLS, window.cells))
    some = [_coarser(one, coarse.cell / window.cell) for one in spread(looks, MOST_LOOKS)]
    heights = _heights(coarse, aperture)
    if len(some) < LEAST_LOOKS:
        return Focus(height=0.0, known=False, agreement=1.0, heights=heights, curve=np.ones(len(heights)))
    curve = np.array([agreement(laid_together(some, coarse, share * flying_height)) for share in heights])
    broadest = MOST_BREADTH * coarse.cell / max(aperture.width, 1e-9) / (heights[1] - heights[0])
    lowest = next(iter(_peaks(curve, broadest)), None)
    if lowest is None:
        agreeing = np.flatnonzero(curve >= AGREES)
        height = float(heights[agreeing[0]]) if agreeing.size else 0.0
        return Focus(height=height, known=False, agreement=float(curve.max()), heights=heights, curve=curve)
    height = _between(heights, curve, lowest)
    return Focus(height=height, known=True, agreement=float(curve[lowest]), heights=heights, curve=curve)


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
    grey = np.stack([_details(one) for one in stack.values]) if len(stack.values) else np.empty((0, 1, 1), np.float32)
    seen = np.isfinite(grey)
    count = seen.sum(axis=0)
    known = count >= LEAST_LOOKS
    if not known.any():
        return 1.0
    values = np.where(seen, grey, 0)[:, known]
    seen, count = seen[:, known], count[known]
    middle = values.sum(axis=0) / count
    within = (np.where(seen, values - middle, 0) ** 2).sum() / (count - 1).sum()
    between = float((count * middle**2).mean())
    return between / max(float(within), 1e-9)


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
    """So close that between two a point at the window's middle moves by a pixel or two over the aperture."""
    moved = aperture.width / max(window.cell, 1e-9) * (HIGHEST - LOWEST)
    return np.linspace(LOWEST, HIGHEST, int(np.clip(moved, 9, MOST_HEIGHTS)))


def _peaks(curve: Array, broadest: float) -> list[int]:
    """Those that stand out from what is between them and any higher one, the lowest first, if they are no chance and not broader
    than so many samples; none if the height of best agreement is: then it is of crowns."""
    best = int(curve.argmax())
    least = max(LEAST_AGREEMENT, 1 + LEAST_SHARE * (float(curve[best]) - 1))
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
    return float(heights[at] + shift * (heights[1] - heights[0]))
