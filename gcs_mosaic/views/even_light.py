"""Pictures freed of exposure and of light that varies slowly, compared with others."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from gcs_mosaic.stitch.arrays import FloatImage, ImageGrey

DARK = 8.0  # grey levels added before the logarithm: noise in the dark is no contrast
MISPLACED = 2  # cells that two pictures may lie apart
FAR = 1e3  # in logarithms: more than any contrast
COARSER = 4  # the mean is taken of so much smaller a picture


def flattened(grey: ImageGrey, around: float) -> FloatImage:
    """Log brightness (h, w) of a picture less its mean within about so many pixels (a Gaussian's standard deviation)."""
    bright = np.log(grey.astype(np.float32) + DARK)
    small = cv2.resize(bright, None, fx=1 / COARSER, fy=1 / COARSER, interpolation=cv2.INTER_AREA)
    mean = cv2.GaussianBlur(small, (0, 0), around / COARSER, borderType=cv2.BORDER_REFLECT)
    return np.asarray(bright - cv2.resize(mean, bright.shape[::-1], interpolation=cv2.INTER_LINEAR), np.float32)


def beyond(own: FloatImage, others: Sequence[FloatImage]) -> FloatImage:
    """How far a picture (h, w) lies above, or below (negative), all that others show within MISPLACED cells (a morphological
    envelope): neither a misregistration of that size nor an edge that is sharper in one of them is a difference. All are
    `flattened`, NaN where nothing is seen; 0 where that holds for the picture itself, and far where no other shows anything."""
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * MISPLACED + 1,) * 2)
    high = np.max([cv2.dilate(np.nan_to_num(one, nan=-FAR), disc) for one in others], axis=0)
    low = np.min([cv2.erode(np.nan_to_num(one, nan=FAR), disc) for one in others], axis=0)
    apart = np.maximum(own - high, 0) - np.maximum(low - own, 0)
    return np.asarray(np.nan_to_num(apart, nan=0.0), np.float32)


def usual_deviation(apart: FloatImage) -> float:
    """Robust standard deviation of differences (n,)."""
    return 1.4826 * float(np.median(np.abs(apart)))
