"""Pictures freed of exposure and of light that varies slowly, to be compared with others."""

from __future__ import annotations

import cv2
import numpy as np

from gcs_mosaic.stitch.arrays import FloatImage, ImageGrey

DARK = 8.0  # grey levels added before the logarithm: noise in the dark is no contrast
COARSER = 4  # the mean is taken of so much smaller a picture


def flattened(grey: ImageGrey, around: float) -> FloatImage:
    """Log brightness (h, w) of a picture less its mean within about so many pixels (a Gaussian's standard deviation)."""
    bright = np.log(grey.astype(np.float32) + DARK)
    small = cv2.resize(bright, None, fx=1 / COARSER, fy=1 / COARSER, interpolation=cv2.INTER_AREA)
    mean = cv2.GaussianBlur(small, (0, 0), around / COARSER, borderType=cv2.BORDER_REFLECT)
    return np.asarray(bright - cv2.resize(mean, bright.shape[::-1], interpolation=cv2.INTER_LINEAR), np.float32)
