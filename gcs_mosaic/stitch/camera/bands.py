"""Images with any number of bands, for OpenCV functions that take at most four."""

from __future__ import annotations

import cv2
import numpy as np

from gcs_mosaic.stitch.arrays import Band, Bands, ImageGrey


def resized(image: Bands, size: tuple[int, int]) -> Bands:
    """Shrink an image (h, w, bands) to `size` (width, height) by area averaging."""
    if image.shape[2] in (3, 4):
        return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA))
    bands = (np.ascontiguousarray(image[..., band]) for band in range(image.shape[2]))
    return np.stack([cv2.resize(band, size, interpolation=cv2.INTER_AREA) for band in bands], axis=-1)


def stretched(band: Band, dark: float = 0.005, bright: float = 0.995) -> ImageGrey:
    """One band (h, w) as 8 bit, stretched between its `dark` and `bright` quantiles."""
    low, high = np.quantile(band, (dark, bright)).tolist()
    levels = (band.astype(np.float32) - np.float32(low)) * np.float32(255 / max(high - low, 1))
    return np.asarray(np.clip(np.rint(levels), 0, 255), dtype=np.uint8)
