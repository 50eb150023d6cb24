"""Homographies between two frames: found from matches that may be wrong, and what they do to points and areas.

MAGSAC++: Barath et al., CVPR 2020 (in OpenCV as USAC_MAGSAC).
"""

from __future__ import annotations

import cv2
import numpy as np

from gcs_mosaic.stitch.arrays import Mask, Matrix3x3, PointsNx2, Vector, Vector2


def robust_homography(a: PointsNx2, b: PointsNx2, threshold: float) -> tuple[Matrix3x3 | None, Mask]:
    """b_from_a (3x3) and the inliers (m,) of matched points (m, 2), or None."""
    homography, inlier = cv2.findHomography(
        a, b, cv2.USAC_MAGSAC, threshold, maxIters=2000, confidence=0.9995
    )  # fmt: skip
    if homography is None or not np.isfinite(homography).all():
        return None, np.zeros(len(a), bool)
    return np.asarray(homography, dtype=np.float64), inlier.ravel().astype(bool)


def area_scale(homography: Matrix3x3, points: PointsNx2) -> Vector:
    """Factor (n,) by which areas around the points (n, 2) grow; not positive behind the camera or seen from below."""
    depth = points @ homography[2, :2] + homography[2, 2]
    with np.errstate(divide="ignore"):
        return np.asarray(np.linalg.det(homography) / depth**3)


def mapped(homography: Matrix3x3, points: PointsNx2) -> PointsNx2:
    """Points (n, 2) after a homography."""
    return np.asarray(cv2.perspectiveTransform(points[None], homography)[0]) if len(points) else points


def inside(points: PointsNx2, size: Vector2) -> Mask:
    """Which points (n, 2) a picture of this size (width, height) holds."""
    return np.asarray(((points >= 0) & (points < size)).all(axis=1))
