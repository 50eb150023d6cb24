"""The adjustment's camera agrees with `geometry`, and its derivatives with differences."""

from collections.abc import Callable

import numpy as np
import pytest

from gcs_mosaic.stitch.arrays import Array
from gcs_mosaic.stitch.camera import geometry, projection
from gcs_mosaic.stitch.camera.geometry import Camera, Pose
from gcs_mosaic.stitch.camera.projection import Projected

M = 40

Views = tuple[Array, Array, Array, Array]  # poses, lenses, half-diagonals, pixels
Project = Callable[[Array, Array, Array, Array], Projected]


@pytest.fixture
def views() -> Views:
    rng = np.random.default_rng(1)
    poses = np.c_[rng.normal(0, 100, (M, 2)), rng.normal(0, 0.3, M), rng.uniform(-3, 3, M), rng.normal(0, 0.2, (M, 2))]
    lenses = np.c_[np.log(rng.uniform(1, 2, M)), rng.uniform(-0.1, 0.1, (M, 2)), rng.normal(0, 0.02, (M, 2))]
    lenses = np.c_[lenses, np.arange(M) % 2]  # every other one a fisheye
    return poses, lenses, np.full(M, 2500.0), rng.uniform(-0.6, 0.6, (M, 2))


def differences(function: Callable[[Array], Array], at: Array) -> Array:
    """Central differences (m, 2, columns) of a function of rows (m, columns)."""
    columns = []
    for k in range(at.shape[1]):
        step = np.zeros_like(at)
        step[:, k] = 1e-6 * (1 + abs(at[:, k]))
        columns.append((function(at + step) - function(at - step)) / (2 * step[:, k : k + 1]))
    return np.stack(columns, axis=2)


def assert_close(analytic: Array, numeric: Array) -> None:
    assert np.abs(analytic - numeric).max() < 1e-5 * np.abs(numeric).max()


def test_it_is_the_camera_of_geometry(views: Views) -> None:
    poses, lenses, half_diagonals, pixels = views
    places = projection.canvas_from_pixels(poses, lenses, half_diagonals, pixels).points
    for pose, lens, pixel, place in zip(poses, lenses, pixels, places, strict=True):
        camera = projection.with_lens(Camera(4000, 3000, fisheye=bool(lens[5])), lens[:5])
        assert np.allclose(projection.lens_row(camera), lens)
        expected = geometry.canvas_from_pixels(Pose(*pose), camera, pixel[None] * camera.half_diagonal + camera.centre)
        assert np.allclose(expected[0], place, atol=1e-5)


def test_up_is_the_inverse_of_down(views: Views) -> None:
    poses, lenses, half_diagonals, pixels = views
    down = projection.canvas_from_pixels(poses, lenses, half_diagonals, pixels)
    up = projection.pixels_from_canvas(poses, lenses, half_diagonals, down.points)
    assert np.allclose(up.points[down.valid], pixels[down.valid])


@pytest.mark.parametrize("project", [projection.canvas_from_pixels, projection.pixels_from_canvas])
def test_derivatives(views: Views, project: Project) -> None:
    poses, lenses, half_diagonals, pixels = views
    points = pixels
    if project is projection.pixels_from_canvas:
        points = projection.canvas_from_pixels(*views).points
    result = project(poses, lenses, half_diagonals, points)
    assert_close(result.by_pose, differences(lambda z: project(z, lenses, half_diagonals, points).points, poses))
    by_lens = differences(lambda z: project(poses, z, half_diagonals, points).points, lenses)[:, :, :5]
    assert_close(result.by_lens, by_lens)
    assert_close(result.by_point, differences(lambda z: project(poses, lenses, half_diagonals, z).points, points))


def test_the_derivative_by_height_is_that_of_a_rising_ground(views: Views) -> None:
    poses, lenses, half_diagonals, pixels = views
    rise = 1.0
    sunk = poses.copy()  # ground that rises by one unit is seen as from one unit lower
    sunk[:, 2] += np.log1p(-rise / np.exp(poses[:, 2] + lenses[:, 0]) / half_diagonals)
    for project, points in (
        (projection.canvas_from_pixels, pixels),
        (projection.pixels_from_canvas, projection.canvas_from_pixels(*views).points),
    ):
        flat, risen = (project(p, lenses, half_diagonals, points) for p in (poses, sunk))
        assert np.allclose(flat.by_height, (risen.points - flat.points) / rise, rtol=5e-3, atol=1e-9)
