"""Sharpness of an image relative to others of the same view."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

_BLOCKS = (24, 18)  # columns and rows of the grid


def sharpness(grey: NDArray[np.uint8]) -> float:
    """Median energy of the Laplacian (Nayar and Nakagawa 1994) over a grid of blocks: hard edges such as text overlaid by the
    camera must not hide blur everywhere else."""
    laplacian = cv2.Laplacian(grey, cv2.CV_32F)
    return float(np.median(cv2.resize(laplacian * laplacian, _BLOCKS, interpolation=cv2.INTER_AREA)))
