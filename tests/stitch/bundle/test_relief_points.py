"""Tracks and the points of the ground that they show."""

import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.stitch.arrays import Array
from gcs_mosaic.stitch.bundle.relief_points import ground_points, tracks


def test_what_is_connected_is_one_point_unless_it_contradicts_itself() -> None:
    frame = np.array([0, 1, 2, 0, 1, 1, 2])
    # 0-1-2 is one point; 3-4 another; 5 and 4 lie in one frame and hang together through 3: a contradiction.
    found = tracks(np.array([[0, 1], [1, 2], [3, 4], [3, 5]]), frame)
    assert found.nodes.tolist() == [0, 1, 2, 6]
    assert found.track[0] == found.track[1] == found.track[2] != found.track[3]


def rays(points: Array, cameras: Array, noise: np.random.Generator) -> tuple[Array, Array, NDArray[np.intp]]:
    """Where the rays from cameras (c, 3) through points (t, 3) meet the plane, their slopes, and which point is whose."""
    camera, point = (array.ravel() for array in np.meshgrid(np.arange(len(cameras)), np.arange(len(points))))
    centre, target = cameras[camera], points[point]
    slope = (target[:, :2] - centre[:, :2]) / (centre[:, 2] - target[:, 2])[:, None]
    return centre[:, :2] + slope * centre[:, 2:] + noise.normal(0, 1, slope.shape), -slope, point


def test_points_are_found_straight_below_where_they_stand() -> None:
    noise = np.random.default_rng(1)
    points = np.c_[noise.uniform(-500, 500, (200, 2)), noise.normal(0, 30, 200)]
    cameras = np.c_[noise.uniform(-800, 800, (6, 2)), np.full(6, 1500.0)]
    places, by_height, track = rays(points, cameras, noise)
    wrong = noise.random(len(track)) < 0.05
    places[wrong] += noise.uniform(-300, 300, (wrong.sum(), 2))
    found = ground_points(places, by_height, np.ones(len(track)), track, height_sigma=60.0)
    error = np.linalg.norm(found.places - points[:, :2], axis=1)
    on_plane = np.linalg.norm(
        [np.bincount(track, places[:, k]) / np.bincount(track) - points[:, k] for k in (0, 1)], axis=0
    )
    assert np.median(error) < 1.5
    assert np.median(on_plane) > 5 * np.median(error)


def test_rays_that_run_together_leave_a_point_on_the_plane() -> None:
    places, slopes = np.array([[0.0, 0.0], [3.0, 0.0]]), np.array([[0.5, 0.0], [0.501, 0.0]])
    found = ground_points(places, slopes, np.full(2, 2.0), np.zeros(2, int), height_sigma=10.0)
    assert np.allclose(found.places, [[1.5, 0.0]], atol=0.05)
