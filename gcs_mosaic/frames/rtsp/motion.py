"""Share of the view that is new since the last frame taken: for flights without triggers."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.stitch.arrays import ImageGrey

_WIDTH = 320  # px; enough to track the ground
_BLOCKS = (8, 6)  # columns and rows: a display burnt into the picture has hard corners, but not everywhere
_CORNERS_EACH = 6
_FEWEST = 12  # common points below which the motion is unknown
_AGREE = 0.2  # share of them that must agree: of many that go anywhere some always do
_ALIKE = 0.5  # ... of those that move, where the others stand still
_ROBUST_PX = 2.0
_STILL_PX, _MOVED_PX = 0.3, 1.0  # between two looks


class ViewMotion:
    """Tracks corners from image to image (Lucas and Kanade 1981) and accumulates the similarities between them.

    `is_lost`: since the last one taken, an image could not be tracked, so how much is new is not known.
    """

    def __init__(self) -> None:
        self.is_lost = False
        self._before: ImageGrey | None = None
        self._now_from_taken = np.eye(3)

    def new_share(self, grey: ImageGrey) -> float:
        """Share of the newest image not covered by the last one taken; 1 if tracking fails."""
        small = _reduced(grey)
        before, self._before = self._before, small
        if before is None or before.shape != small.shape:
            return 1.0
        step = None if self.is_lost else _motion(before, small)
        if step is None:
            self.is_lost = True
            return 1.0
        self._now_from_taken = step @ self._now_from_taken
        return 1.0 - _overlap(self._now_from_taken, small.shape[1], small.shape[0])

    def taken(self) -> None:
        """Make the newest image the reference for later ones."""
        self.is_lost = False
        self._now_from_taken = np.eye(3)


def _reduced(grey: ImageGrey) -> ImageGrey:
    scale = min(1.0, _WIDTH / grey.shape[1])
    size = max(1, round(scale * grey.shape[1])), max(1, round(scale * grey.shape[0]))
    return np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_AREA), np.uint8)


def _motion(before: ImageGrey, now: ImageGrey) -> NDArray[np.float64] | None:
    """now_from_before (3x3), a similarity; None with too few common points."""
    corners = _corners(before)
    if len(corners) < _FEWEST:
        return None
    found, state, _ = cv2.calcOpticalFlowPyrLK(before, now, corners, np.empty_like(corners))
    kept = state.ravel() == 1
    corners, found = corners[kept, 0], found[kept, 0]
    similarity = _similarity(corners, found)
    if similarity is None:
        return None
    # What stands still while much else moves in one way is the camera's own display, however much there is of it.
    moved = np.linalg.norm(found - corners, axis=1) > _MOVED_PX
    if _shift(similarity, corners) < _STILL_PX and moved.sum() >= 2 * _FEWEST:
        beneath = _similarity(corners[moved], found[moved], _ALIKE)
        similarity = similarity if beneath is None else beneath
    return np.vstack([similarity, [0.0, 0.0, 1.0]])


def _corners(grey: ImageGrey) -> NDArray[np.float32]:
    """(n, 1, 2): the best of each block."""
    height, width = grey.shape
    columns, rows = _BLOCKS
    found = [np.empty((0, 1, 2), np.float32)]
    for row in range(rows):
        for column in range(columns):
            top, left = row * height // rows, column * width // columns
            block = grey[top : (row + 1) * height // rows, left : (column + 1) * width // columns]
            corners = cv2.goodFeaturesToTrack(block, _CORNERS_EACH, 0.01, 5) if block.size else None
            if corners is not None:
                found.append((corners + np.array([left, top])).astype(np.float32))
    return np.concatenate(found)


def _similarity(
    before: NDArray[np.float32], now: NDArray[np.float32], share: float = _AGREE
) -> NDArray[np.float64] | None:
    """now_from_before (2x3), to which at least this share of the points agree."""
    if len(before) < _FEWEST:
        return None
    found, inliers = cv2.estimateAffinePartial2D(before, now, method=cv2.RANSAC, ransacReprojThreshold=_ROBUST_PX)
    if found is None or inliers.sum() < max(share * len(before), _FEWEST):
        return None
    return np.asarray(found, np.float64)


def _shift(similarity: NDArray[np.float64], points: NDArray[np.float32]) -> float:
    """Median shift of the points, px."""
    return float(np.median(np.linalg.norm(points @ similarity[:, :2].T + similarity[:, 2] - points, axis=1)))


def _overlap(now_from_taken: NDArray[np.float64], width: int, height: int) -> float:
    """Share of the image covered by the outline of the taken one."""
    frame = np.array([[0, 0], [width, 0], [width, height], [0, height]], np.float32)
    moved = cv2.perspectiveTransform(frame[None], now_from_taken)[0].astype(np.float32)
    area, _ = cv2.intersectConvexConvex(frame, moved)
    return float(area) / (width * height)
