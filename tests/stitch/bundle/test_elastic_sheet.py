"""Sheets fitted to values: at zero where nothing is known, unmoved by what stands out, and steep at the foot of a wall."""

import numpy as np

from gcs_mosaic.stitch.bundle.elastic_sheet import Elasticity, fitted_sheet, grid_size, on_sheet
from gcs_mosaic.stitch.camera.geometry import Camera

SIZE = (17, 13)
SMOOTH = Elasticity(stiffness=0.3, step=np.inf, tie=0.01, loss=1.0)


def test_a_sheet_lies_at_zero_where_nothing_is_known_and_ignores_what_stands_out() -> None:
    noise = np.random.default_rng(4)
    at = noise.uniform(0, 0.4, (400, 2))
    values = np.tile([5.0, -2.0], (400, 1))
    values[::20] = 300
    sheet = fitted_sheet(at, values, SIZE, SMOOTH)
    assert np.allclose(sheet[2, 3], [5, -2], atol=0.2)
    assert np.abs(sheet[-1, -1]).max() < 1


def test_cells_are_nearly_square() -> None:
    assert grid_size(Camera(4000, 3000), 16) == (17, 13)
    assert grid_size(Camera(3000, 4000), 16) == (13, 17)


def test_at_the_foot_of_a_wall_a_sheet_gives_way() -> None:
    at = np.random.default_rng(5).uniform(0, 1, (600, 2))
    values = np.where(at[:, :1] < 0.47, 0.0, 4.0)
    foot = np.array([[0.44, 0.3], [0.44, 0.6]])  # half a cell from the wall
    steep = Elasticity(stiffness=1.0, step=0.4, tie=0.01, loss=1.0)
    smooth = Elasticity(stiffness=1.0, step=np.inf, tie=0.01, loss=1.0)
    given_way, drawn_along = (on_sheet(fitted_sheet(at, values, SIZE, one), foot) for one in (steep, smooth))
    assert np.all(np.abs(given_way) < 0.5 * np.abs(drawn_along))


def test_values_count_by_their_weight() -> None:
    at = np.tile([[0.5, 0.5]], (2, 1))
    sheet = fitted_sheet(at, np.array([[0.0], [1.0]]), SIZE, SMOOTH, np.array([1e-6, 1.0]))
    assert on_sheet(sheet, at[:1]).item() > 0.5
