"""Image sharpness relative to other images of the same ground."""

from __future__ import annotations

import math

import cv2
import numpy as np

from gcs_mosaic.stitch.arrays import Band, Bands, FloatPlanes

PIXELS = 500_000  # examined, in strips over the whole image: some rows suffice to measure its finest detail
STRIP = 16  # rows
COARSE = 8  # px; detail of this size survives blur that removes the finest, and has the same exposure
BLOCKS = 24  # per strip; the median over all blocks is used, because burnt-in text is sharp in every image


def sharpness(image: Bands) -> float:
    """Amplitude of the finest detail of an image (h, w[, bands]) relative to coarser detail; 0 for a uniform one.

    The smaller value of the two directions: motion blur affects only one.
    """
    strips = _strips(image if image.ndim == 2 else image[..., image.shape[2] // 2])
    fine, coarse = _energies(strips, 1), _energies(strips, COARSE)
    return min(
        math.sqrt(of_fine / of_coarse) if of_coarse > 0 else 0.0
        for of_fine, of_coarse in zip(fine, coarse, strict=True)
    )


def _strips(band: Band) -> FloatPlanes:
    """Strips of rows (n, STRIP, w), evenly spaced over the image."""
    height, width = band.shape
    count = max(1, min(height // STRIP, PIXELS // (STRIP * width)))
    rows = np.linspace(0, max(height - STRIP, 0), count).astype(int)
    return np.stack([band[row : row + STRIP] for row in rows]).astype(np.float32)


def _energies(strips: FloatPlanes, step: int) -> tuple[float, float]:
    """Energy of the differences across `step` pixels, horizontally and vertically; median over blocks."""
    across = strips[:, :-step, step:] - strips[:, :-step, :-step]
    down = strips[:, step:, :-step] - strips[:, :-step, :-step]
    return _middle(across * across), _middle(down * down)


def _middle(energy: FloatPlanes) -> float:
    if not energy.size:
        return 0.0
    of_rows = energy.mean(axis=1)
    return float(np.median(cv2.resize(of_rows, (BLOCKS, len(of_rows)), interpolation=cv2.INTER_AREA)))
