"""The look of a frame's parts: colour, brightness and detail of each of its cells.

By it other parts of a flight are found that show ground of the same kind (`graph.silent_ground`): water, lawn, roofs.
"""

from __future__ import annotations

import cv2
import numpy as np

from gcs_mosaic.stitch.arrays import Band, Bands, FloatImage, FloatRows
from gcs_mosaic.stitch.features.frame_cells import CELLS, COLUMNS, ROWS

MOST_BANDS = 4  # that colour is told by
SAMPLED = 32  # pixels at least along a cell that are looked at for its colour
BLOCK = 4  # px of the feature picture across which fine details vary; coarser ones across as many of these


def looks(image: Bands, grey: FloatImage) -> FloatRows:
    """Look (CELLS, k) of the cells of an image (h, w[, bands]): logarithms of its brightness, of each band
    but the first over the first, and of its fine and coarser details; `grey` (h, w): its feature picture."""
    step = max(1, min(image.shape[0] // (ROWS * SAMPLED), image.shape[1] // (COLUMNS * SAMPLED)))
    sampled = image[::step, ::step].reshape(*image[::step, ::step].shape[:2], -1)[..., :MOST_BANDS]
    bands = np.log(_means(sampled) + 1)
    fine, blocks = _varying(grey - grey.mean())
    details = [np.log(_means(variance) + 1) / 2 for variance in (fine, _varying(blocks)[0])]
    told = [bands.mean(axis=1, keepdims=True), bands[:, 1:] - bands[:, :1], *details]
    return np.concatenate(told, axis=1).astype(np.float32)


def _varying(grey: FloatImage) -> tuple[FloatImage, FloatImage]:
    """Variance and mean (h / BLOCK, w / BLOCK) of the blocks of an image (h, w)."""
    size = max(1, grey.shape[1] // BLOCK), max(1, grey.shape[0] // BLOCK)
    mean, square = (cv2.resize(one, size, interpolation=cv2.INTER_AREA) for one in (grey, grey * grey))
    return np.maximum(square - mean * mean, np.float32(0)), np.asarray(mean, np.float32)


def _means(image: Band | Bands) -> FloatRows:
    """Means (CELLS, bands) of the cells of an image (h, w, bands)."""
    small = cv2.resize(np.ascontiguousarray(image, np.float32), (COLUMNS, ROWS), interpolation=cv2.INTER_AREA)
    return np.asarray(small.reshape(CELLS, -1), np.float32)
