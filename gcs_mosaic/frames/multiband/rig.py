"""How the lenses of a camera of several bands stand to each other, as its shots have told so far; and what all of them see."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

import cv2
import numpy as np

from gcs_mosaic.frames.multiband.registration import corners, mapped
from gcs_mosaic.stitch.arrays import Matrix3x3

NEWEST = 15  # clear registrations of a band, whose median counts: near the ground lenses stand apart by more
MARGIN_STEP_PX = 8  # so that a shot that differs by a pixel does not change the size of frames
WIDEST_MARGIN = 0.2  # of the picture's sides


class Rig:
    """Of pictures of one size."""

    def __init__(self, width: int, height: int) -> None:
        self.width, self.height = width, height
        self._found: dict[str, deque[Matrix3x3]] = {}
        self._margins = (0, 0)

    def note(self, camera: str, homography: Matrix3x3) -> None:
        """A registration that is clear, from the reference's pixels to this band's."""
        self._found.setdefault(camera, deque(maxlen=NEWEST)).append(homography)

    def times(self, camera: str) -> int:
        """How often that has been clear, up to a limit."""
        return len(self._found.get(camera, ()))

    def usual(self, camera: str) -> Matrix3x3 | None:
        """The median; None if none has been clear."""
        if not self.times(camera):
            return None
        ends = corners(self.width, self.height)
        places = np.median([mapped(one, ends) for one in self._found[camera]], axis=0)
        return np.asarray(cv2.getPerspectiveTransform(ends.astype(np.float32), places.astype(np.float32)), np.float64)

    def margins(self, homographies: Iterable[Matrix3x3]) -> tuple[int, int] | None:
        """Pixels (x, y) that are cut off on both sides, lest a band has none there; None if that would be too many.

        Both sides alike: the optical axis stays in the middle. They never shrink, so that nearly all frames have one size.
        """
        x, y = self._margins
        for homography in homographies:
            while (lacks := self._lacks(homography, x, y)) != (False, False):
                x, y = x + MARGIN_STEP_PX * lacks[0], y + MARGIN_STEP_PX * lacks[1]
                if x > WIDEST_MARGIN * self.width or y > WIDEST_MARGIN * self.height:
                    return None
        self._margins = x, y
        return x, y

    def _lacks(self, homography: Matrix3x3, x: int, y: int) -> tuple[bool, bool]:
        """Whether the band ends within these margins, aside and above or below."""
        ends = corners(self.width - 2 * x, self.height - 2 * y) + np.array([x, y])
        places, last = mapped(homography, ends), np.array([self.width - 1, self.height - 1])
        beyond = (places < 0) | (places > last)
        return bool(beyond[:, 0].any()), bool(beyond[:, 1].any())
