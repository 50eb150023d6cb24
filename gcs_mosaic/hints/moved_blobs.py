"""What one look shows and none of the others at the same ground does: things that have moved between them.

Looks are compared on the map's plane. A value counts only as far as it lies beyond all that the other looks show within a few
cells (a morphological envelope), so that neither a misregistration of that size nor an edge that is sharper in one of them is
taken for a thing. Logarithms and the local mean make it blind to exposure and to light that varies slowly.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from gcs_mosaic.stitch.arrays import FloatImage, FloatPlanes, Mask
from gcs_mosaic.views.even_light import beyond, usual_deviation

AROUND = 16.0  # cells, as of `views.even_light.flattened`: a vehicle is shorter
LEAST_CONTRAST = 0.1  # in logarithms, a tenth brighter or darker than all other looks
NOISES = 4.0  # times the usual difference of two looks, where that is more
LEAST_CELLS, MOST_CELLS = 3, 900  # of a thing: a person of two cells; a lorry
MOST_BLOBS = 60  # of a frame, the strongest
LEAST_OTHERS = 2  # with one other alone nobody can tell which of the two shows the thing
SAMPLE = 101  # every so manieth cell tells the usual difference


@dataclass(frozen=True, slots=True)
class MovedBlob:
    """A thing in one frame: where (cells of its window), how large, and how much brighter (darker: negative) than the ground in
    the other looks."""

    column: float
    row: float
    cells: int
    contrast: float

    @property
    def size(self) -> float:
        """Side of the square of its area, in cells."""
        return float(np.sqrt(self.cells))


def moved_in(own: FloatImage, others: Sequence[FloatImage]) -> list[MovedBlob]:
    """What only the first of several looks (h, w) shows, the strongest first: all as `flattened`, NaN where nothing is seen."""
    if len(others) < LEAST_OTHERS:
        return []
    stack = np.stack(others)
    judged = np.isfinite(own) & (np.isfinite(stack).sum(axis=0) >= LEAST_OTHERS)
    if not judged.any():
        return []
    apart = beyond(own, others)
    apart[~judged] = 0
    strong = np.abs(apart) > max(LEAST_CONTRAST, NOISES * _usual_difference(own, stack, judged))
    count, labels, facts, middles = cv2.connectedComponentsWithStats(strong.astype(np.uint8), connectivity=8)
    found = []
    for label in range(1, count):
        left, top, width, height, cells = facts[label].tolist()
        if LEAST_CELLS <= cells <= MOST_CELLS:
            box = np.s_[top : top + height, left : left + width]
            contrast = float(apart[box][labels[box] == label].mean())
            column, row = middles[label].tolist()
            found.append(MovedBlob(column, row, cells, contrast))
    return sorted(found, key=lambda one: -abs(one.contrast) * one.cells)[:MOST_BLOBS]


def _usual_difference(own: FloatImage, stack: FloatPlanes, judged: Mask) -> float:
    """Robust standard deviation of a look less the middle of the others."""
    rows, columns = (where[::SAMPLE] for where in np.nonzero(judged))
    apart = np.asarray(own[rows, columns] - np.nanmedian(stack[:, rows, columns], axis=0), np.float32)
    return usual_deviation(apart)
