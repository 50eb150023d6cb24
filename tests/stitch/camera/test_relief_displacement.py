"""Relief displacement of one frame: there and back, and never a folded picture."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from painting_parts import SMALL, hilly

from gcs_mosaic.render.warp_grid import frame_lattice
from gcs_mosaic.stitch.camera.geometry import Camera, Pose, pixel_grid
from gcs_mosaic.stitch.camera.relief import ReliefDisplacement, as_seen, on_plane

CAMERA = Camera(400, 300)


@given(st.integers(0, 1000), st.floats(0, 0.2))
def test_there_and_back(seed: int, size: float) -> None:
    relief = ReliefDisplacement.from_grid(np.random.default_rng(seed).normal(0, size, (7, 9, 2)))
    pixels = pixel_grid(CAMERA, 23, 17)
    assert np.allclose(as_seen(relief, CAMERA, on_plane(relief, CAMERA, pixels)), pixels, atol=0.02)


@given(st.integers(0, 1000), st.floats(0.01, 10))
def test_no_picture_is_folded(seed: int, size: float) -> None:
    relief = ReliefDisplacement.from_grid(np.random.default_rng(seed).normal(0, size, (7, 9, 2)))
    x, y = on_plane(relief, CAMERA, pixel_grid(CAMERA, 400, 300)).reshape(300, 400, 2).transpose(2, 0, 1)
    (x_down, x_right), (y_down, y_right) = np.gradient(x), np.gradient(y)
    assert (x_right * y_down - x_down * y_right > 0).all()


def test_what_is_too_steep_is_evened_out_there_alone() -> None:
    grid = np.full((13, 17, 2), 0.01)
    grid[1, 1] = 0.3
    found = ReliefDisplacement.from_grid(grid).grid
    assert np.allclose(found[8:, 10:], 0.01, atol=1e-4)
    assert found[1, 1].min() > 0.05


def test_the_shift_between_nodes_is_bilinear_and_scales_with_the_frame() -> None:
    grid = np.zeros((2, 3, 2))
    grid[0, 1] = 0.02, -0.01
    relief = ReliefDisplacement.from_grid(grid)
    for camera in (CAMERA, Camera(200, 150)):
        middle_of_top = np.array([[(camera.width - 1) / 2, 0]])
        quarter = np.array([[(camera.width - 1) / 4, (camera.height - 1) / 2]])
        full = np.array([0.02, -0.01]) * camera.half_diagonal
        assert np.allclose(relief.at(camera, middle_of_top), full, rtol=1e-5)
        assert np.allclose(relief.at(camera, quarter), full / 4, rtol=1e-5)


def test_beyond_the_frame_the_border_counts_and_nowhere_stays_nowhere() -> None:
    relief, camera = hilly(1), CAMERA
    corner, beyond = np.array([[0.0, 0.0]]), np.array([[-50.0, -90.0]])
    assert np.allclose(relief.at(camera, corner), relief.at(camera, beyond))
    assert np.isnan(as_seen(relief, camera, np.array([[np.nan, np.nan]]))).all()


@pytest.mark.parametrize("seed", range(3))
def test_a_frame_is_painted_where_its_relief_says(seed: int) -> None:
    relief, pose = hilly(seed), Pose(10.0, -20.0, 0.0, 0.5)
    lattice = frame_lattice(pose, SMALL, 16, relief)
    flat = frame_lattice(pose, SMALL, 16)
    assert lattice is not None
    assert flat is not None
    inside = lattice.inside()
    back = on_plane(relief, SMALL, lattice.pixels[inside].astype(float))
    rows = (lattice.first.y - flat.first.y) * 16
    columns = (lattice.first.x - flat.first.x) * 16
    flat_pixels = np.full_like(lattice.pixels, np.nan)
    height, width = lattice.pixels.shape[:2]
    flat_part = flat.pixels[max(rows, 0) : rows + height, max(columns, 0) : columns + width]
    flat_pixels[max(-rows, 0) :, max(-columns, 0) :][: flat_part.shape[0], : flat_part.shape[1]] = flat_part
    expected = flat_pixels[inside]
    known = np.isfinite(expected).all(axis=1)
    assert known.sum() > 20
    assert np.allclose(back[known], expected[known], atol=0.01)
