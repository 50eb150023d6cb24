"""At which heights something lies in focus, by the looks alone.

As in an analysis of variance: where nothing is in focus the looks differ as chance has it, and the variance of their mean over
the pixels is theirs divided by their number. The ratio of the two is 1 then, and more where the same thing lies in all looks.
Over woods crowns are in focus, too: the ground is the lowest height that is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from gcs_mosaic.integral.stack import GroundWindow, Look, laid
from gcs_mosaic.stitch.arrays import FloatImage, Vector

FINE, COARSE = 3, 15  # px: between these sizes lies what is compared; light and slopes of it are coarser
# What chance does not do: over 100 x 100 px with details of 3 px some 1,000 are independent, so that the ratio is 1 +- 0.05. Two
# looks through the same gap, and leaves out of focus that are larger than COARSE, make it more.
LEAST_RATIO = 1.25
MOST_RATIO = 1e4  # more is rounding: looks of one camera that stands still are equal at all heights
PROMINENCE = 0.15  # share of a peak's ratio above 1 by which the curve must fall on both sides


@dataclass(frozen=True, slots=True, kw_only=True)
class FoundFocus:
    """A height in focus and the heights between which it lies, in the units of those that were tried."""

    height: float
    lowest: float
    highest: float


def agreement(looks: Sequence[Look], window: GroundWindow, height: float) -> float:
    """The ratio of variances at a height in canvas units; 1 where the looks share nothing, NaN where less than two overlap."""
    count = np.zeros((window.cells, window.cells), np.float32)
    total, squares = np.zeros_like(count), np.zeros_like(count)
    for look in looks:
        shown = laid(look, window, height)
        if shown is not None:
            fine = _details(shown)
            known = np.isfinite(fine)
            fine[~known] = 0
            count += known
            total += fine
            squares += fine * fine
    enough = count >= 2
    if not enough.any():
        return float("nan")
    count, total, squares = count[enough], total[enough], squares[enough]
    between = float((total * total / count).mean())
    within = float(((squares - total * total / count) / (count - 1)).mean())
    return min(between / max(within, 1e-12), MOST_RATIO)


def lowest_focus(heights: Vector, ratios: Vector) -> FoundFocus | None:
    """The lowest peak of `agreement` (n,) over heights (n,), rising, that chance does not make; None where there is none. A peak
    at either end of the heights is none: it may lie beyond."""
    for at in range(1, len(heights) - 1):
        peak = float(ratios[at])
        if not (peak >= LEAST_RATIO and peak >= ratios[at - 1] and peak >= ratios[at + 1]):
            continue
        fallen = ratios < 1 + (1 - PROMINENCE) * (peak - 1)
        before, after = np.flatnonzero(fallen[:at]), np.flatnonzero(fallen[at + 1 :])
        if not before.size or not after.size:
            continue
        low, high = int(before[-1]), int(after[0]) + at + 1
        if ratios[low : high + 1].max() <= peak:
            return FoundFocus(height=float(heights[at]), lowest=float(heights[low]), highest=float(heights[high]))
    return None


def _details(shown: FloatImage) -> FloatImage:
    """(h, w) of a look (h, w, bands): what is larger than FINE and smaller than COARSE; NaN near what it does not see."""
    grey = shown.mean(axis=2)
    known = np.isfinite(grey)
    filled = np.where(known, grey, 0).astype(np.float32)
    details = cv2.blur(filled, (FINE, FINE)) - cv2.blur(filled, (COARSE, COARSE))
    well_inside = cv2.erode(known.astype(np.uint8), np.ones((COARSE, COARSE), np.uint8), borderValue=1) > 0
    return np.where(well_inside, details, np.nan).astype(np.float32)
