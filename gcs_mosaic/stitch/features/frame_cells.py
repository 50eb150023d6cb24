"""The cells of a frame: a grid, numbered row by row, each of which has dozens of features over textured ground."""

from __future__ import annotations

import numpy as np

from gcs_mosaic.stitch.arrays import AnyPointsNx2, Counts, Indices, PointsNx2

COLUMNS, ROWS = 8, 6
CELLS = COLUMNS * ROWS


def cell_of(pixels: AnyPointsNx2, width: int, height: int) -> Indices:
    """In which cell of a frame of this size each of the pixels (n, 2) lies, (n,)."""
    column, row = ((pixels.astype(np.float64) + 0.5) * [COLUMNS / width, ROWS / height]).astype(np.intp).T
    return np.asarray(row.clip(0, ROWS - 1) * COLUMNS + column.clip(0, COLUMNS - 1))


def counts(pixels: AnyPointsNx2, width: int, height: int) -> Counts:
    """Number of pixels (n, 2) in each cell, (CELLS,)."""
    return np.bincount(cell_of(pixels, width, height), minlength=CELLS)


def centres(width: int, height: int) -> PointsNx2:
    """The middle of each cell, (CELLS, 2)."""
    row, column = np.divmod(np.arange(CELLS), COLUMNS)
    return np.stack([(column + 0.5) * width / COLUMNS, (row + 0.5) * height / ROWS], axis=1) - 0.5
