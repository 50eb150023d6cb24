"""Section III.C: the homography from the frame to the mosaic, by the direct linear transform within RANSAC.

RANSAC: Fischler and Bolles, CACM 24(6), 1981. Direct linear transform: Hartley and Zisserman, "Multiple View Geometry", 4.1.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from gcs_mosaic.stitch.arrays import Matrix3x3, PointsNx2
from gcs_mosaic.stitch.graph.placement import Rejection

LEAST_MATCHES = 4  # that determine a homography


@dataclass(frozen=True, slots=True)
class Fit:
    """mosaic_from_frame (3x3), number of inliers, and their residual (median, mosaic pixels)."""

    mosaic_from_frame: Matrix3x3
    inliers: int
    residual_px: float


def fit_homography(
    name: str, frame: PointsNx2, mosaic: PointsNx2, threshold_px: float, least_inliers: int
) -> Fit | Rejection:
    """Homography from matched points of a frame (m, 2) to those of the mosaic (m, 2)."""
    if len(frame) < LEAST_MATCHES:
        return Rejection(name, f"{len(frame)} matches with the region of interest, {LEAST_MATCHES} needed")
    homography, inlier = cv2.findHomography(frame, mosaic, cv2.RANSAC, threshold_px)
    if homography is None or not np.isfinite(homography).all():
        return Rejection(name, f"no homography fits its {len(frame)} matches with the region of interest")
    agree = inlier.ravel().astype(bool)
    if agree.sum() < least_inliers:
        text = f"{agree.sum()} of {len(frame)} matches with the region of interest agree, {least_inliers} needed"
        return Rejection(name, text)
    missed = cv2.perspectiveTransform(frame[agree][None], homography)[0] - mosaic[agree]
    residual_px = float(np.median(np.linalg.norm(missed, axis=1)))
    return Fit(np.asarray(homography, dtype=np.float64), int(agree.sum()), residual_px)
