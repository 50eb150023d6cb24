"""Matches off the plane that are still consistent with the same two viewpoints.

Two views of a plane are related by a homography. A point above or below it is displaced along the line through the epipole
("plane plus parallax": Irani and Anandan, IEEE PAMI 20(6), 1998). Two displaced matches determine the epipole; the number of
others it explains separates tree crowns and roofs from chance.
"""

from __future__ import annotations

import numpy as np
from scipy.special import bdtrc

from gcs_mosaic.stitch.arrays import Mask, PointsNx2, RowsNx3

# Of the image diagonal: largest parallax considered. Trees an eighth of the flying height tall at 60 % overlap. From 0.04 to
# 0.06 the results are the same; at 0.08 similar trees in rows are mistaken for one another's tops.
LARGEST = 0.05
EPIPOLAR_PX = 2.0  # tolerance to the epipolar line, pixels of the feature picture
HYPOTHESES = 200  # epipoles tried: with a fifth of the displaced matches right, 8 of them come from two right ones
LEAST_CHANCE = 1e-3  # of so many matches agreeing with one of the hypotheses by accident


def displaced_by_height(mapped: PointsNx2, matched: PointsNx2, on_plane: Mask, diagonal: float) -> Mask:
    """Which matches (n,) show points above or below the plane.

    mapped, matched (n, 2): both ends of the matches in pixels of frame b, the first mapped there by the plane's homography;
    on_plane (n,): its inliers.
    """
    displacement = np.linalg.norm(matched - mapped, axis=1)
    displaced = np.flatnonzero(~on_plane & (displacement < LARGEST * diagonal))
    found = np.zeros(len(mapped), bool)
    if len(displaced) <= SAMPLE:
        return found
    middle = mapped[displaced].mean(axis=0)
    source, target = (_homogeneous((points[displaced] - middle) / diagonal) for points in (mapped, matched))
    first, second = np.random.default_rng(0).integers(0, len(displaced), (2, HYPOTHESES))
    lines = np.cross(source, target)
    epipoles = np.cross(lines[first], lines[second])
    size = np.linalg.norm(epipoles, axis=1)
    epipoles = epipoles[size > 1e-12] / size[size > 1e-12, None]
    through = np.cross(source[None], epipoles[:, None])  # (h, n, 3), each match's epipolar line by each hypothesis
    off = abs((through * target).sum(axis=2)) / np.maximum(np.hypot(through[..., 0], through[..., 1]), 1e-12)
    agree = off * diagonal < EPIPOLAR_PX
    if not len(agree):
        return found
    best = agree[agree.sum(axis=1).argmax()]
    # Probability that a match displaced in a random direction lies within the band around its epipolar line.
    chance = 4 * EPIPOLAR_PX / (np.pi * LARGEST * diagonal / 2)
    accident = HYPOTHESES * bdtrc(int(best.sum()) - SAMPLE - 1, len(displaced) - SAMPLE, min(chance, 1.0))
    found[displaced[best]] = accident < LEAST_CHANCE
    return found


SAMPLE = 2  # displaced matches that determine an epipole


def _homogeneous(points: PointsNx2) -> RowsNx3:
    return np.column_stack([points, np.ones(len(points))])
