"""Images with any number of bands, for OpenCV functions that take at most four."""

from __future__ import annotations

import cv2
import numpy as np

from gcs_mosaic.stitch.arrays import AnyImage, Band, Bands, ImageGrey


def resized(image: Bands, size: tuple[int, int]) -> Bands:
    """Shrink an image (h, w, bands) to `size` (width, height) by area averaging."""
    if image.shape[2] in (3, 4):
        return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA))
    bands = (np.ascontiguousarray(image[..., band]) for band in range(image.shape[2]))
    return np.stack([cv2.resize(band, size, interpolation=cv2.INTER_AREA) for band in bands], axis=-1)


def counts_of_ground(image: Bands) -> AnyImage:
    """Pixels (n, bands) of an image (h, w, bands) by which a range is chosen: of 16 bits without those that are zero in all
    bands, as dead lines, borders without data and what is no number are, unless there are no others."""
    pixels = image.reshape(-1, image.shape[2])
    known = pixels.any(axis=1) if image.dtype == np.uint16 else np.ones(len(pixels), bool)
    return pixels if known.all() or not known.any() else pixels[known]


def stretched(band: Band, dark: float = 0.005, bright: float = 0.995) -> ImageGrey:
    """One band (h, w) as 8 bit, stretched between the `dark` and `bright` quantiles of its ground."""
    low, high = np.quantile(counts_of_ground(band[..., None]), (dark, bright)).tolist()
    levels = (band.astype(np.float32) - np.float32(low)) * np.float32(255 / max(high - low, 1))
    return np.asarray(np.clip(np.rint(levels), 0, 255), dtype=np.uint8)
