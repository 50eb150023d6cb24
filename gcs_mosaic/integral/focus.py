"""The ground's height beneath trees, sought by itself: at which heights the looks agree.

Where something lies at a height, all looks that see it show the same there, and the mean of them keeps its contrast; elsewhere
they show unrelated things, and the mean has what is left of unrelated things: the variance of one look over their number. The
ratio of the two is the F of an analysis of variance, 1 where nothing is in focus. (Visibility over heights by grey level
variance: I. Kurmi, D. C. Schedl, O. Bimber, IEEE Geoscience and Remote Sensing Letters 18(4), 2021.) Of the heights at which
the looks agree the lowest is the ground, for nothing is to be seen below it; the others are crowns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from gcs_mosaic.integral.aperture import SyntheticAperture
from gcs_mosaic.integral.flight_looks import HIGHEST, LOWEST
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
# Beside the height of best agreement: rows of trees and of houses agree with their neighbours at other heights, too, by some per
# cent of that (5 % in an orchard).
LEAST_SHARE = 0.1
LEAST_LOOKS = 3  # two always agree somewhere


@dataclass(frozen=True, slots=True, kw_only=True)
class Focus:
    """`height`: share of the flying height above the map's ground; `known`: whether looks agree there more than by chance;
    `agreement`: how much more, 1 by chance; `heights`, `curve`: all that were tried, and how much looks agree there."""

    height: float
    known: bool
    agreement: float
    heights: Array
    curve: Array


def ground_focus(
    looks: Sequence[GroundLook], window: GroundWindow, flying_height: float, aperture: SyntheticAperture
) -> Focus:
    """Seek it about a window's middle; the map's ground where it cannot be told."""
    coarse = GroundWindow(window.x, window.y, window.side, min(CELLS, window.cells))
    some = [_coarser(one, coarse.cell / window.cell) for one in looks[:: -(-len(looks) // MOST_LOOKS)]]
    heights = _heights(coarse, aperture)
    if len(some) < LEAST_LOOKS:
        return Focus(height=0.0, known=False, agreement=1.0, heights=heights, curve=np.ones(len(heights)))
    curve = np.array([agreement(laid_together(some, coarse, share * flying_height)) for share in heights])
    least = max(LEAST_AGREEMENT, 1 + LEAST_SHARE * (float(curve.max()) - 1))
    lowest = next((at for at in _peaks(curve) if curve[at] >= least), None)
    if lowest is None:
        return Focus(height=0.0, known=False, agreement=float(curve.max()), heights=heights, curve=curve)
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


def _peaks(curve: Array) -> list[int]:
    """Those that stand out from what is between them and any higher one, the lowest height first."""
    found = list[int]()
    for at, value in enumerate(curve):
        below, above = _least_to_higher(curve[:at][::-1], value), _least_to_higher(curve[at + 1 :], value)
        if max(below, above) < LEAST_DIP * value:
            found.append(at)
    return found


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
