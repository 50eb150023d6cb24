"""Weighting of match residuals where the ground may lie above or below the plane."""

from __future__ import annotations

import numpy as np

from gcs_mosaic.stitch.arrays import Matrices, PointsNx2


def discount(parallax: PointsNx2) -> PointsNx2:
    """Vectors q (m, 2) that whiten residuals with covariance I + parallax parallax^T, by I - q q^T.

    A point that may lie above or below the plane is only known to fall on a line: along it, one standard deviation of height
    shifts it by the parallax (m, 2) px, on top of one pixel of matching noise.
    """
    known = np.nan_to_num(parallax)
    squared = (known**2).sum(axis=1)
    along = (1 - 1 / np.sqrt(1 + squared)) / np.maximum(squared, 1e-12)
    return np.asarray(np.sqrt(along)[:, None] * known)


def whitened(discounts: PointsNx2, values: Matrices) -> Matrices:
    """Residuals or their derivatives (m, 2, k), whitened; as `discount` gives them."""
    along = discounts[:, 0, None] * values[:, 0] + discounts[:, 1, None] * values[:, 1]
    return values - discounts[:, :, None] * along[:, None]
