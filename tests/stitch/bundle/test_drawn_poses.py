"""Over ground that is not on the plane a frame is drawn where the ground is, seen from above."""

from dataclasses import replace

import numpy as np
import pytest
from sighted_hills import CAMERA, HEIGHT, sighted, survey

from gcs_mosaic.stitch.arrays import Array, Indices
from gcs_mosaic.stitch.bundle.drawn_poses import drawn_poses
from gcs_mosaic.stitch.bundle.problem import Problem
from gcs_mosaic.stitch.camera import projection
from gcs_mosaic.stitch.camera.projection import lens_row, lens_terms


def plateau(places: Array) -> Array:
    return np.full(len(places), 0.2 * HEIGHT)


def slope(places: Array) -> Array:
    return np.asarray(0.2 * places[:, 0])


def misses(problem: Problem, poses: Array, row: Indices, pixels: Array, places: Array) -> Array:
    lens, half = np.tile(lens_row(CAMERA), (len(row), 1)), problem.half_diagonal[np.zeros(len(row), int)]
    up = projection.pixels_from_canvas(poses[row], lens, half, places)
    return np.asarray(np.linalg.norm(up.points - pixels, axis=1))


def test_a_frame_over_a_plateau_is_drawn_as_one_that_flies_lower() -> None:
    truth = survey(1)
    problem, seen, points = sighted(truth, plateau, 1)
    problem = with_true_lens(problem)
    drawn = drawn_poses(problem, seen, points)
    assert np.exp(drawn[:, 2] - truth[:, 2]) == pytest.approx(
        np.exp(-truth[:, 2]) * (np.exp(truth[:, 2]) - 0.2), rel=0.01
    )
    assert np.abs(drawn[:, :2] - truth[:, :2]).max() < 0.005 * HEIGHT


def test_a_slope_is_drawn_much_better_than_over_the_plane() -> None:
    truth = survey(2)
    problem, seen, points = sighted(truth, slope, 2)
    problem = with_true_lens(problem)
    drawn = drawn_poses(problem, seen, points)
    before, after = (
        np.median(misses(problem, poses, seen.row, seen.pixels, points[seen.point, :2])) for poses in (truth, drawn)
    )
    assert after < 0.2 * before


def with_true_lens(problem: Problem) -> Problem:
    return replace(problem, lenses=np.array([lens_terms(CAMERA)]))
