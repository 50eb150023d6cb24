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


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(
    ("cell", "column", "row", "shown"),
    [
        (2.0, 7, 4, [(4, 7)]),  # as fine as what is known: that cell alone
        (6.0, 7, 4, [(1, 2)]),  # three times as coarse: the cell of columns 6 to 8 and rows 3 to 5
        (6.0, 8, 5, [(1, 2)]),  # in its corner
        (10.0, 2, 2, [(0, 0)]),
        (10.0, 4, 2, [(0, 0)]),
        (10.0, 5, 2, [(0, 1)]),
        (1.0, 3, 2, [(4, 6), (4, 7), (5, 6), (5, 7)]),  # finer: all four that lie in it
    ],
)
def test_one_change_is_shown_by_the_cells_that_it_lies_in(
    cell: float, column: int, row: int, shown: list[tuple[int, int]], sign: float
) -> None:
    """On grids that begin where the comparison begins; its cells are 2 units wide."""
    strength = np.zeros((20, 30), np.float32)
    strength[row, column] = sign * 0.5
    found = _greatest(strength, window(30, 20), Grid(-30.0, 20.0, cell, 10, 10))
    assert np.argwhere(found > 0).tolist() == [list(one) for one in shown]
    assert found.max() == 0.5


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
