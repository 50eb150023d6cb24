"""Weighting of match residuals where the ground may lie above or below the plane."""

from __future__ import annotations

import numpy as np

from gcs_mosaic.stitch.arrays import Matrices, PointsNx2


def whitening(parallax: PointsNx2) -> Matrices:
    """Whitening matrices (m, 2, 2) of residuals with covariance I + parallax parallax^T.

    A point that may lie above or below the plane is only known to fall on a line: along it, one standard deviation of height
    shifts it by the parallax (m, 2) px, on top of one pixel of matching noise.
    """
    squared = (np.nan_to_num(parallax) ** 2).sum(axis=1)
    along = (1 - 1 / np.sqrt(1 + squared)) / np.maximum(squared, 1e-12)
    return np.asarray(np.eye(2) - along[:, None, None] * parallax[:, :, None] * parallax[:, None, :])
