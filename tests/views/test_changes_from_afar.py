"""Tiles of what changed, however coarse they are asked for."""

from __future__ import annotations

import time

import cv2
import numpy as np
import pytest

from gcs_mosaic.stitch.arrays import FloatImage
from gcs_mosaic.views.coverage import Grid
from gcs_mosaic.views.layers import CELLS, _greatest


def window(columns: int, rows: int) -> Grid:
    return Grid(left=-30.0, top=20.0, cell=2.0, columns=columns, rows=rows)


def dilated(strength: FloatImage, over: Grid, grid: Grid) -> FloatImage:
    """The same by a kernel as large as a cell of the grid."""
    reach = max(1, round(grid.cell / over.cell)) | 1
    part = cv2.dilate(np.abs(strength), np.ones((reach, reach), np.uint8))
    found = np.zeros((grid.rows, grid.columns), np.float32)
    for row, column in np.ndindex(found.shape):
        y = int(np.floor((grid.top + (row + 0.5) * grid.cell - over.top) / over.cell))
        x = int(np.floor((grid.left + (column + 0.5) * grid.cell - over.left) / over.cell))
        if 0 <= y < over.rows and 0 <= x < over.columns:
            found[row, column] = part[y, x]
    return found


@pytest.mark.parametrize("cell", [0.7, 2.0, 5.0, 8.0, 41.0, 5000.0])
@pytest.mark.parametrize("corner", [(-100.0, -50.0), (0.0, 60.0), (9000.0, 0.0)])
def test_the_greatest_change_in_a_cell_is_shown(cell: float, corner: tuple[float, float]) -> None:
    strength = np.random.default_rng(1).normal(0, 1, (90, 120)).astype(np.float32)
    grid = Grid(*corner, cell, 24, 24)
    over = window(120, 90)
    np.testing.assert_array_equal(_greatest(strength, over, grid), dilated(strength, over, grid))


def test_a_tile_of_all_the_world_costs_little_more_than_a_look_at_each_cell() -> None:
    """Not a look at each cell's whole neighbourhood."""
    strength = np.zeros((3000, 3000), np.float32)
    strength[10, 2000] = -1.0
    side = 12_000.0
    grid = Grid(-30.0 - side * CELLS / 2, 20.0 - side * CELLS / 2, side, CELLS, CELLS)
    whole = Grid(-30.0, 20.0, 6000.0, 1, 1)
    began = time.thread_time()
    np.abs(strength).max()
    once = time.thread_time() - began
    began = time.thread_time()
    assert _greatest(strength, window(3000, 3000), whole).max() == 1.0
    assert _greatest(strength, window(3000, 3000), grid).shape == (CELLS, CELLS)
    assert time.thread_time() - began < 50 * once
