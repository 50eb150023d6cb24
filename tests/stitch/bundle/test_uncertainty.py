"""Stated deviations against those that come about when the same flight is measured again and again."""

import math
from dataclasses import replace

import numpy as np
import pytest
from matched_frames import SCALE, problem_of

from gcs_mosaic.stitch.arrays import Array
from gcs_mosaic.stitch.bundle.levenberg_marquardt import AdjustmentSettings, Solution, adjust
from gcs_mosaic.stitch.bundle.problem import Problem
from gcs_mosaic.stitch.bundle.uncertainty import island_certainty, resected_deviation, variance_factor
from gcs_mosaic.stitch.camera import geometry, projection
from gcs_mosaic.stitch.camera.geometry import Camera, Pose, similarity_between
from tests.tiers import thorough

CAMERA = Camera(4000, 3000, 1.4, -0.08)
ROOT = 2
RUNS = 40
CORNERS = geometry.frame_border(CAMERA, 1)


def survey() -> Array:
    """True poses (12, 6): three lines of four frames with tilt, heading and height that change."""
    rng = np.random.default_rng(8)
    x, y = np.meshgrid(np.arange(4) * 1200.0, np.arange(3) * 1500.0)
    tilted = rng.normal(0, 0.1, 12), rng.normal(0, 0.3, 12), rng.normal(0, 0.05, (12, 2))
    poses: Array = np.c_[(x.ravel(), y.ravel(), *tilted)]
    return poses


def true_matches(poses: Array, per_pair: int = 24) -> Problem:
    """All pairs that overlap, without noise."""
    rng, pairs, a, b = np.random.default_rng(9), [], [], []
    for i in range(len(poses)):
        for j in range(i):
            pixels = rng.uniform(0, 1, (600, 2)) * [CAMERA.width, CAMERA.height]
            places = geometry.canvas_from_pixels(Pose(*poses[i]), CAMERA, pixels)
            other = geometry.pixels_from_canvas(Pose(*poses[j]), CAMERA, places)
            inside = np.flatnonzero(((other > 0) & (other < [CAMERA.width, CAMERA.height])).all(axis=1))[:per_pair]
            if len(inside) == per_pair:
                pairs.append((i, j))
                a.append(pixels[inside])
                b.append(other[inside])
    return problem_of(CAMERA, poses, projection.lens_terms(CAMERA), pairs, a, b)


def measured(problem: Problem, noise_px: float, rng: np.random.Generator) -> Problem:
    """The same with noise, feature pixels."""
    noise = noise_px * SCALE / CAMERA.half_diagonal
    a, b = (pixels + rng.normal(0, noise, pixels.shape) for pixels in (problem.pixels_a, problem.pixels_b))
    return replace(problem, pixels_a=a, pixels_b=b)


def corners(poses: Array, camera: Camera) -> Array:
    return np.array([geometry.canvas_from_pixels(Pose(*pose), camera, CORNERS) for pose in poses])


def corner_errors(solution: Solution, truth: Array) -> Array:
    """Distances (n, 4) of all corners from the truth, once the root lies as well over its true place as it goes."""
    found = corners(solution.poses, projection.with_lens(CAMERA, solution.lenses[0]))
    true = corners(truth, CAMERA)
    scale, angle, shift = similarity_between(found[ROOT], true[ROOT])
    c, s = math.cos(angle), math.sin(angle)
    off = np.linalg.norm(scale * found @ np.array([[c, s], [-s, c]]) + shift - true, axis=2)
    return np.asarray(off / np.exp(truth[:, 2:3]))


@pytest.mark.long
@pytest.mark.parametrize("noise_px", [thorough(0.1), 0.7])
def test_deviations_are_those_that_come_about(noise_px: float) -> None:
    truth, rng = survey(), np.random.default_rng(11)
    exact, settings, errors, stated = true_matches(truth), AdjustmentSettings(), [], []
    for _ in range(RUNS):
        problem = measured(exact, noise_px, rng)
        solution = adjust(problem, settings)
        errors.append(corner_errors(solution, truth))
        stated.append(island_certainty(problem, solution, [CAMERA], ROOT, settings.loss_px).deviations_px)
    came_about = np.sqrt((np.array(errors) ** 2).mean(axis=0)).max(axis=1)
    ratio = came_about / np.median(stated, axis=0)
    assert 0.85 < np.median(ratio) < 1.15
    assert ((ratio > 0.6) & (ratio < 1.6)).all()
    assert came_about.argmin() == np.median(stated, axis=0).argmin() == ROOT


def test_a_frame_beside_others_that_are_held() -> None:
    truth, rng = survey(), np.random.default_rng(12)
    order = np.array([5, 0, 1, 2, 4, 6, 8, 9, 10])  # the middle one first, then those around it
    exact = true_matches(truth[order])
    linked = (exact.pairs == 0).any(axis=1)
    exact = replace(
        exact, pairs=exact.pairs[linked], pixels_a=exact.pixels_a[linked], pixels_b=exact.pixels_b[linked],
        present=exact.present[linked], free=np.arange(len(order)) == 0, lens_free=False,
    )  # fmt: skip
    settings, errors, stated = AdjustmentSettings(), [], []
    for _ in range(RUNS):
        problem = measured(exact, 0.5, rng)
        solution = adjust(problem, settings)
        off = corners(solution.poses[:1], CAMERA)[0] - corners(truth[order[:1]], CAMERA)[0]
        errors.append(np.linalg.norm(off, axis=1) / math.exp(truth[order[0], 2]))
        factor = variance_factor(solution.residuals_px, settings.loss_px, 6)
        stated.append(resected_deviation(problem, solution, [CAMERA], factor))
    came_about = np.sqrt((np.array(errors) ** 2).mean(axis=0)).max()
    assert 0.75 < came_about / np.median(stated) < 1.33


def test_wrong_matches_count_little() -> None:
    """One match in ten is wrong by far: the deviations stay what the others make of them."""
    truth, rng = survey(), np.random.default_rng(13)
    right = measured(true_matches(truth), 0.5, rng)
    wrong = rng.random(right.present.shape) < 0.1
    spoilt = replace(
        right, pixels_b=np.where(wrong[:, :, None], rng.uniform(-0.5, 0.5, right.pixels_b.shape), right.pixels_b)
    )
    settings = AdjustmentSettings()
    clean, dirty = (
        island_certainty(problem, adjust(problem, settings), [CAMERA], ROOT, settings.loss_px).deviations_px
        for problem in (right, spoilt)
    )
    assert ((dirty > 0.9 * clean) & (dirty < 1.5 * clean)).all()


def test_what_is_not_determined_is_infinite() -> None:
    """Two frames with two matches: fewer measurements than unknowns."""
    truth = survey()[:2]
    problem = true_matches(truth, per_pair=2)
    solution = adjust(problem, AdjustmentSettings())
    found = island_certainty(problem, solution, [CAMERA], 0, 1.0)
    assert np.isinf(found.deviations_px).all()
    assert found.lens_information is None
