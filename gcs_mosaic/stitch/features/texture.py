"""Texture of a frame: a small picture of its structure, freed of brightness, contrast and gradients.

Keypoints say what a few places look like; the texture says what all of them do. It is what two frames are compared by as
pictures (`registration.agreement`): each pixel's deviation from the mean around it, divided by the usual deviation around it,
so that sun, exposure, vignetting, a thermal camera's range and its gain do not count.
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from gcs_mosaic.stitch.arrays import Band, FloatImage, Matrix3x3, Texture

PIXELS = 480 * 360  # of a texture; the area, so that any shape of frame has as many
AROUND = 16.0  # px, sigma of the local mean that is subtracted
LOCAL = 24.0  # px, sigma of the neighbourhood that is normalised to unit deviation
LEAST_LOCAL = 0.5  # of the median local deviation; quieter areas are not amplified further: they show only noise
FLAT = 1e-3  # counts, deviation of an image without any structure
PER_DEVIATION = 24  # quantisation steps of a texture per local deviation
COARSE_BLUR = 1.5  # px of the coarse texture, sigma: leaves what a proposal that is some px off still finds


def texture(grey: Band) -> Texture:
    """The texture (h, w) of a grey image of any depth, in 1 / PER_DEVIATION of the local deviation; never enlarged."""
    factor = min(1.0, math.sqrt(PIXELS / grey.size))
    size = max(1, round(grey.shape[1] * factor)), max(1, round(grey.shape[0] * factor))
    small = cv2.resize(grey.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    standing_out = small - cv2.GaussianBlur(small, (0, 0), AROUND)
    local = np.sqrt(cv2.GaussianBlur(standing_out * standing_out, (0, 0), LOCAL))
    least = max(LEAST_LOCAL * float(np.median(local)), FLAT)
    steps = np.rint(standing_out * (PER_DEVIATION / np.maximum(local, least)))
    return np.asarray(np.clip(steps, -127, 127), dtype=np.int8)


def coarse(fine: Texture) -> FloatImage:
    """A texture at half its size, smoothed: what two frames share in spite of parallax, wind and noise."""
    size = max(1, fine.shape[1] // 2), max(1, fine.shape[0] // 2)
    half = cv2.resize(fine.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.GaussianBlur(half, (0, 0), COARSE_BLUR), dtype=np.float32)


def full_from_picture(width: int, height: int, shape: tuple[int, ...]) -> Matrix3x3:
    """Pixels of a frame of this size from those of a picture of all of it, of this shape (h, w); centres are whole numbers in
    both."""
    x, y = width / shape[1], height / shape[0]
    return np.array([[x, 0, x / 2 - 0.5], [0, y, y / 2 - 0.5], [0, 0, 1.0]])
