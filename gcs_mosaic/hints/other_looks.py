"""Whether the other looks at a place show what one of them does: what only one shows has moved."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass

import cv2
import numpy as np

from gcs_mosaic.hints.anomalies import Appearance
from gcs_mosaic.stitch.arrays import Array

POOL = 4  # pixels a side of which the greatest contrast is kept
PER_UNIT = 8.0  # steps of 8 bits per unit of contrast
KEPT_FRAMES = 48  # newest: a quarter of a megabyte each, and some strips of a survey
MISPLACED = 10  # px that a thing may lie off its place in another frame: relief, and what stitching leaves
SHOWN = 0.5  # of its contrast: light and blur differ between looks
MARGIN = 12  # px from the border, within which a look does not count


@dataclass(frozen=True, slots=True)
class Verdict:
    """How many other looks there were at a place, and how many of them show the same contrast."""

    looks: int = 0
    shown: int = 0

    def __add__(self, other: Verdict) -> Verdict:
        return Verdict(self.looks + other.looks, self.shown + other.shown)


UNJUDGED = Verdict()


class OtherLooks:
    """The contrasts of the newest frames, by number."""

    def __init__(self) -> None:
        self._pooled: OrderedDict[int, Array] = OrderedDict()

    def __contains__(self, frame: int) -> bool:
        return frame in self._pooled

    @property
    def frames(self) -> list[int]:
        return list(self._pooled)

    def keep(self, frame: int, seen: Appearance) -> None:
        """Keep a frame's contrasts, and forget the oldest."""
        widest = cv2.dilate(seen.contrast, np.ones((POOL, POOL), np.uint8))
        pooled = np.clip(PER_UNIT * widest[::POOL, ::POOL], 0, 255).astype(np.uint8)
        self._pooled[frame] = pooled
        self._pooled.move_to_end(frame)
        while len(self._pooled) > KEPT_FRAMES:
            self._pooled.popitem(last=False)

    def verdict(self, frame: int, x: float, y: float, size: float, contrast: float) -> Verdict:
        """What a frame shows at its pixel x, y of something of a size (px) and contrast."""
        pooled = self._pooled[frame]
        height, width = pooled.shape[0] * POOL, pooled.shape[1] * POOL
        if not (MARGIN <= x < width - MARGIN and MARGIN <= y < height - MARGIN):  # NaN is outside too
            return UNJUDGED
        reach = MISPLACED + size / 2
        left, top = max(0, int((x - reach) // POOL)), max(0, int((y - reach) // POOL))
        window = pooled[top : int((y + reach) // POOL) + 1, left : int((x + reach) // POOL) + 1]
        least = min(255.0, PER_UNIT * SHOWN * contrast)
        return Verdict(1, int(window.max() >= least))
