"""Images with almost no contrast (thermal cameras over cold fields, haze): equalising their faint structure.

SIFT's threshold is absolute, and its finest scales see only the noise of such a sensor. So the image is halved, high-pass
filtered (vignetting, gradients), blurred until pixel noise is gone, and divided by its local standard deviation.
"""

from __future__ import annotations

import cv2
import numpy as np

from gcs_mosaic.stitch.arrays import Band, FaintImage, FloatImage, ImageGrey
from gcs_mosaic.stitch.features.detectors import FeatureKind, Found, detect

HALF = 2  # px of the feature picture per px of a faint one
AROUND = 12.0  # px of the faint picture, sigma of the local mean that is subtracted
BLUR = 2.5  # px of it, sigma; of 87 pairs of a noisy flight 26 matched at 0.75, 38 at 1.25, 48 at 2.5
LOCAL = 16.0  # px of it, sigma of the neighbourhood that is normalised to unit deviation
LEAST_LOCAL = 0.5  # of the median local deviation; quieter areas are not amplified further: they show only noise
PER_DEVIATION = 16  # quantisation steps of a faint picture per robust standard deviation
LEAST_DEVIATION = 0.1  # counts; less is rounding
CONTRAST = 40  # grey levels per local deviation in the image features are detected in
# ratio; 2.2 and more over cold fields, 1.95 and less elsewhere except dry grass (2.3), which reaches the feature limit
NOISY = 2.0


def faint_picture(grey: Band) -> FaintImage:
    """A grey image (h, w) of any depth, halved and high-pass filtered, in 1 / PER_DEVIATION of its robust deviation."""
    size = max(1, grey.shape[1] // HALF), max(1, grey.shape[0] // HALF)
    small = cv2.resize(grey.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    standing_out = small - cv2.GaussianBlur(small, (0, 0), AROUND)
    deviation = 1.4826 * float(np.median(np.abs(standing_out)))
    steps = np.rint(standing_out * (PER_DEVIATION / max(deviation, LEAST_DEVIATION)))
    return np.asarray(np.clip(steps, -127, 127), dtype=np.int8)


def detect_faint(standing_out: Band, kind: FeatureKind, count: int, contrast: float) -> Found:
    """Features of a faint picture (h, w), with or without its fixed pattern; points in pixels of the feature picture."""
    found = detect(equalised(standing_out), kind, count, contrast)
    return Found((found.points + 0.5) * HALF - 0.5, found.descriptors)


def equalised(standing_out: Band, blur: float = BLUR) -> ImageGrey:
    """A faint picture (h, w), with or without its fixed pattern, as the image that features are detected in."""
    blurred = blurred_faint(standing_out, blur)
    local = np.sqrt(cv2.GaussianBlur(blurred * blurred, (0, 0), LOCAL))
    least = max(LEAST_LOCAL * float(np.median(local)), 1e-3)
    return np.clip(np.rint(128 + CONTRAST * blurred / np.maximum(local, least)), 0, 255).astype(np.uint8)


def blurred_faint(standing_out: Band, blur: float = BLUR) -> FloatImage:
    """The faint picture without pixel noise and without the local mean that blurring leaves."""
    blurred = cv2.GaussianBlur(standing_out.astype(np.float32), (0, 0), blur)
    return np.asarray(blurred - cv2.GaussianBlur(blurred, (0, 0), AROUND), dtype=np.float32)


def is_noise(grey: ImageGrey) -> bool:
    """Whether a grey image (h, w) is mostly pixel noise: far more of it than of structure some px wide."""
    levels = grey.astype(np.float32)
    finest = np.median(np.abs(levels - cv2.GaussianBlur(levels, (0, 0), 1))[1::3, 1::3])
    size = max(1, grey.shape[1] // 2), max(1, grey.shape[0] // 2)
    half = cv2.resize(levels, size, interpolation=cv2.INTER_AREA)  # structure some px wide survives this
    coarser = cv2.GaussianBlur(half, (0, 0), 2)
    structure = np.median(np.abs(coarser - cv2.GaussianBlur(coarser, (0, 0), 4))[::2, ::2])
    return bool(finest > NOISY * structure)
