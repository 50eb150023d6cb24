"""What stands out in an integral: hints, never a filter.

RX (Reed and Yu, IEEE Trans. ASSP 38(10), 1990; on integrals: Nathan, Kurmi and Bimber, Remote Sensing 15(18), 2023): the
Mahalanobis distance of a pixel to the mean of the square around it, by the covariance of the whole picture. Noise falls with the
number of looks, which differs from pixel to pixel, so the distance is taken relative to that. Of a single band, as of a thermal
camera, only what is brighter than its surroundings counts: beneath a canopy people are warmer than what is around them.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np

from gcs_mosaic.integral.forms import LEAST_LOOKS
from gcs_mosaic.integral.stack import GroundWindow
from gcs_mosaic.stitch.arrays import AnyArray, FloatImage, Matrix

# In pixels of the integral, which are those of the looks.
CENTRE = 3  # smaller is noise
SURROUND = 41  # a few times a person
APART = 10  # two peaks nearer than that are one thing


@dataclass(frozen=True, slots=True, kw_only=True)
class HotPlace:
    """A thing that stands out: its canvas place, the focus in which it does so most, and by how many standard deviations."""

    x: float
    y: float
    height: float
    score: float


def oddity(values: FloatImage, looks: Matrix) -> FloatImage:
    """RX of an integral (h, w, bands) with so many looks (h, w) of each pixel, in standard deviations; 0 where not known."""
    known = np.isfinite(values).all(axis=2) & (looks >= LEAST_LOOKS)
    if not known.any():
        return np.zeros(known.shape, np.float32)
    local = _blurred(values, known, CENTRE) - _blurred(values, known, SURROUND)
    local *= np.sqrt(looks / looks.max())[..., None]
    some = local[known]
    covariance = some.T @ some / len(some) + 1e-6 * np.eye(some.shape[1], dtype=np.float32)
    whitened = local @ np.linalg.inv(np.linalg.cholesky(covariance)).T.astype(np.float32)
    if whitened.shape[2] == 1:
        return np.where(known, np.maximum(whitened[..., 0], 0), 0).astype(np.float32)
    return np.where(known, np.sqrt((whitened * whitened).sum(axis=2)), 0).astype(np.float32)


def peaks(odd: FloatImage, window: GroundWindow, height: float, most: int) -> list[HotPlace]:
    """The pixels (h, w) that stand out most among those near them, the oddest first."""
    around = cv2.dilate(odd, np.ones((2 * APART + 1,) * 2, np.uint8))
    rows, columns = np.nonzero((odd >= around) & (odd > 0))
    order = np.argsort(-odd[rows, columns], kind="stable")[:most]
    return [_hot(odd, window, height, int(rows[one]), int(columns[one])) for one in order]


def over_heights(found: Iterable[HotPlace], reach: float) -> list[HotPlace]:
    """One of each thing that stands out in several focuses, the oddest first; `reach`: canvas units between two that are one."""
    kept: list[HotPlace] = []
    for one in sorted(found, key=lambda hot: -hot.score):
        if all((one.x - other.x) ** 2 + (one.y - other.y) ** 2 > reach**2 for other in kept):
            kept.append(one)
    return kept


def _hot(odd: FloatImage, window: GroundWindow, height: float, row: int, column: int) -> HotPlace:
    x, y = window.place_of(column, row)
    return HotPlace(x=x, y=y, height=height, score=float(odd[row, column]))


def _blurred(values: FloatImage, known: AnyArray, side: int) -> FloatImage:
    """Means of the known pixels in squares (h, w, bands); 0 where there are none."""
    weight = known.astype(np.float32)
    total = cv2.blur(np.where(known[..., None], values, 0).astype(np.float32), (side, side)).reshape(values.shape)
    share = cv2.blur(weight, (side, side))[..., None]
    return np.asarray(np.where(known[..., None], total / np.maximum(share, 1e-6), 0), np.float32)
