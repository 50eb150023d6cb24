"""Share of the view that is new since the last frame taken: for flights without triggers."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.stitch.arrays import ImageGrey

_WIDTH = 320  # px; enough to track the ground
_CORNERS = 200
_FEWEST = 12  # common points below which the motion is unknown
_ROBUST_PX = 2.0


class ViewMotion:
    """Tracks corners from image to image (Lucas and Kanade 1981) and accumulates the similarities between them."""

    def __init__(self) -> None:
        self._before: ImageGrey | None = None
        self._now_from_taken = np.eye(3)

    def new_share(self, grey: ImageGrey) -> float:
        """Share of the newest image not covered by the last one taken; 1 if tracking fails."""
        small = _reduced(grey)
        before, self._before = self._before, small
        if before is None or before.shape != small.shape:
            return 1.0
        step = _motion(before, small)
        if step is None:
            return 1.0
        self._now_from_taken = step @ self._now_from_taken
        return 1.0 - _overlap(self._now_from_taken, small.shape[1], small.shape[0])

    def taken(self) -> None:
        """Make the newest image the reference for later ones."""
        self._now_from_taken = np.eye(3)


def _reduced(grey: ImageGrey) -> ImageGrey:
    scale = min(1.0, _WIDTH / grey.shape[1])
    size = max(1, round(scale * grey.shape[1])), max(1, round(scale * grey.shape[0]))
    return np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_AREA), np.uint8)


def _motion(before: ImageGrey, now: ImageGrey) -> NDArray[np.float64] | None:
    """now_from_before (3x3), a similarity; None with too few common points."""
    corners = cv2.goodFeaturesToTrack(before, _CORNERS, 0.01, 5)
    if corners is None or len(corners) < _FEWEST:
        return None
    found, state, _ = cv2.calcOpticalFlowPyrLK(before, now, corners, np.empty_like(corners))
    kept = state.ravel() == 1
    if kept.sum() < _FEWEST:
        return None
    similarity, inliers = cv2.estimateAffinePartial2D(
        corners[kept], found[kept], method=cv2.RANSAC, ransacReprojThreshold=_ROBUST_PX
    )
    if similarity is None or inliers.sum() < _FEWEST:
        return None
    return np.vstack([similarity, [0.0, 0.0, 1.0]])


def _overlap(now_from_taken: NDArray[np.float64], width: int, height: int) -> float:
    """Share of the image covered by the outline of the taken one."""
    frame = np.array([[0, 0], [width, 0], [width, height], [0, height]], np.float32)
    moved = cv2.perspectiveTransform(frame[None], now_from_taken)[0].astype(np.float32)
    area, _ = cv2.intersectConvexConvex(frame, moved)
    return float(area) / (width * height)
