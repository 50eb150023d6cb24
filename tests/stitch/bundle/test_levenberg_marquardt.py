"""The adjustment finds poses and lens from matches whose truth is known."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from matched_frames import problem_of

from gcs_mosaic.stitch.arrays import Array
from gcs_mosaic.stitch.bundle import lens
from gcs_mosaic.stitch.bundle import levenberg_marquardt as adjustment
from gcs_mosaic.stitch.bundle.levenberg_marquardt import AdjustmentSettings, Solution, adjust
from gcs_mosaic.stitch.bundle.problem import Problem
from gcs_mosaic.stitch.bundle.residuals import discounts_of, parts
from gcs_mosaic.stitch.camera import geometry, projection
from gcs_mosaic.stitch.camera.geometry import Camera, Pose, similarity_between

CAMERA = Camera(4000, 3000, 1.4, -0.08, 0.03, 0.01, -0.015)
RNG = np.random.default_rng(3)


def flight(lines: int, per_line: int) -> Array:
    """True poses (n, 6) of a survey with tilt, heading and height that change."""
    x, y = np.meshgrid(np.arange(per_line) * 1200.0, np.arange(lines) * 1500.0)
    n = x.size
    poses: Array = np.c_[
        x.ravel(), y.ravel(), RNG.normal(0, 0.1, n), RNG.normal(0, 0.3, n), RNG.normal(0, 0.05, (n, 2))
    ]
    return poses


def seen_on_relief(pose: Pose, other: Pose, pixels: Array, relief: float) -> Array:
    """Where another frame sees what these pixels show, if the ground rises and falls by `relief` canvas units."""
    places = geometry.canvas_from_pixels(pose, CAMERA, pixels)
    height = np.exp(pose.log_gsd) * CAMERA.focal_px
    rise = RNG.normal(0, 1, (len(pixels), 1)) * relief
    ground = places - (places - [pose.x, pose.y]) * rise / height
    other_height = np.exp(other.log_gsd) * CAMERA.focal_px
    raised = [other.x, other.y] + (ground - [other.x, other.y]) * other_height / (other_height - rise)
    return geometry.pixels_from_canvas(other, CAMERA, raised)


def matches(poses: Array, noise_px: float, wrong: float = 0.0, per_pair: int = 24, relief: float = 0.0) -> Problem:
    """The problem of linking all frames that overlap, from the poses of the truth; `relief` in canvas units."""
    pairs, a, b = [], [], []
    for i in range(len(poses)):
        for j in range(i):
            if np.linalg.norm(poses[i, :2] - poses[j, :2]) > 2600:
                continue
            pixels = RNG.uniform(0, 1, (400, 2)) * [CAMERA.width, CAMERA.height]
            other = seen_on_relief(Pose(*poses[i]), Pose(*poses[j]), pixels, relief)
            inside = np.flatnonzero(((other > 0) & (other < [CAMERA.width, CAMERA.height])).all(axis=1))[:per_pair]
            if len(inside) == per_pair:
                pairs.append((i, j))
                a.append(pixels[inside] + RNG.normal(0, noise_px, (per_pair, 2)))
                seen = other[inside] + RNG.normal(0, noise_px, (per_pair, 2))
                lost = RNG.random(per_pair) < wrong
                seen[lost] = RNG.uniform(0, 3000, (lost.sum(), 2))
                b.append(seen)
    return problem_of(CAMERA, poses, [np.log(1.5), 0.0, 0.0, 0.0, 0.0], pairs, a, b)


def rough(poses: Array) -> Array:
    """What pairwise placement would know: level poses, a little off."""
    start = poses + RNG.normal(0, 1, poses.shape) * [60, 60, 0.03, 0.03, 0, 0]
    start[:, 4:] = 0
    return start


def map_error(solution: Solution, truth: Array) -> float:
    """RMS distance of the frames' inner corners from the truth, after one similarity, full-resolution pixels."""
    corners = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]]) * 0.7
    n = len(truth)

    def places(poses: Array, lens: Array) -> Array:
        half = np.full(4 * n, CAMERA.half_diagonal)
        return projection.canvas_from_pixels(
            poses.repeat(4, 0), np.tile(lens, (4 * n, 1)), half, np.tile(corners, (n, 1))
        ).points

    found, true = (
        places(solution.poses, solution.lenses[0]),
        places(truth, np.array(projection.lens_row(CAMERA))),
    )
    scale, angle, shift = similarity_between(found, true)
    c, s = np.cos(angle), np.sin(angle)
    return float(np.sqrt((((scale * found @ np.array([[c, s], [-s, c]]) + shift) - true) ** 2).sum(1).mean()))


@pytest.mark.parametrize("wrong", [0.0, 0.1])
def test_the_shape_of_the_map_and_the_lens_are_found(wrong: float) -> None:
    truth = flight(4, 6)
    problem = replace(matches(truth, noise_px=2.0, wrong=wrong), poses=rough(truth))
    solution = adjust(problem, AdjustmentSettings())
    assert map_error(solution, truth) < 3.0
    assert abs(np.exp(solution.lenses[0, 0]) - CAMERA.focal) < 0.03
    assert abs(solution.lenses[0, 1] - CAMERA.k1) < 0.02
    assert np.abs(solution.lenses[0, 3:] - [CAMERA.shift_x, CAMERA.shift_y]).max() < 0.003


def test_expected_parallax_keeps_relief_from_bending_the_map() -> None:
    truth = flight(4, 6)
    relief = 0.03 * CAMERA.focal_px
    problem = replace(matches(truth, noise_px=2.0, relief=relief), poses=rough(truth))
    unaware, aware = (
        adjust(problem, AdjustmentSettings()),
        adjust(replace(problem, relief=relief), AdjustmentSettings()),
    )
    assert map_error(aware, truth) < 0.5 * map_error(unaware, truth)


def test_the_error_is_seen_before_it_is_mended() -> None:
    truth = flight(2, 4)
    problem = replace(matches(truth, noise_px=2.0), poses=rough(truth))
    bent = adjust(problem, AdjustmentSettings(steps=0))
    assert map_error(bent, truth) > 20


def test_fixed_frames_do_not_move() -> None:
    truth = flight(2, 3)
    problem = matches(truth, noise_px=2.0)
    problem = replace(problem, poses=rough(truth), free=np.arange(6) == 2, lens_free=False)
    solution = adjust(problem, AdjustmentSettings())
    assert (solution.poses[np.arange(6) != 2] == problem.poses[np.arange(6) != 2]).all()
    assert (solution.poses[2] != problem.poses[2]).any()
    assert (solution.lenses == problem.lenses).all()


def test_one_dense_front_and_many_small_ones_agree(monkeypatch: pytest.MonkeyPatch) -> None:
    truth = flight(3, 8)
    problem = replace(matches(truth, noise_px=1.0), poses=rough(truth))
    dense = adjust(problem, AdjustmentSettings())
    monkeypatch.setattr("gcs_mosaic.stitch.bundle.dissection.LEAF_FRAMES", 2)
    sparse = adjust(problem, AdjustmentSettings())
    assert len(dense.normal.layout.plan.top.steps) == 1
    assert len(sparse.normal.layout.plan.top.steps) > 1
    assert np.abs(dense.poses - sparse.poses).max() < 1e-6
    assert np.abs(dense.lenses - sparse.lenses).max() < 1e-9


def test_two_frames_do_not_determine_a_lens() -> None:
    truth = flight(1, 2)
    truth[:, 2:] = 0
    solution = adjust(replace(matches(truth, noise_px=2.0)), AdjustmentSettings())
    assert 1.2 < np.exp(solution.lenses[0, 0]) < 1.9
    assert abs(solution.lenses[0, 1]) < 0.12


def test_the_gradient_is_that_of_the_cost() -> None:
    """Else steps lead elsewhere than the cost says: parallax that followed the poses was a way to lower it."""
    truth = flight(2, 4)
    relief = 0.03 * CAMERA.focal_px
    problem = replace(matches(truth, noise_px=2.0, relief=relief), relief=relief, poses=rough(truth))
    settings, fixed = AdjustmentSettings(), [discounts_of(part) for part in parts(problem)]
    here = adjustment._first_state(problem, settings)
    problem = here.problem
    layout = here.normal.layout
    step = RNG.normal(0, 1e-5, here.gradient.shape) / np.sqrt(here.normal.diagonal)
    ahead, behind = (
        adjustment._evaluate(adjustment.stepped(problem, layout, sign * step), settings, fixed, layout).cost
        for sign in (1, -1)
    )
    expected = 4 * (here.gradient * step).sum()  # the cost is the sum of squares, not half
    assert ahead - behind == pytest.approx(expected, rel=1e-3)


@pytest.mark.long
@pytest.mark.parametrize(("bound", "value"), [("LONGEST_FOCAL", 1.2), ("MOST_BARREL", 0.01)])
def test_poses_are_found_though_the_true_lens_is_beyond_what_is_believed(
    monkeypatch: pytest.MonkeyPatch, bound: str, value: float
) -> None:
    """With the lens at the edge of that, no other poses would do better."""
    monkeypatch.setattr(lens, bound, value)
    truth, settings = flight(4, 6), AdjustmentSettings()
    problem = replace(matches(truth, noise_px=2.0), poses=rough(truth))
    found = adjust(problem, settings)
    assert np.allclose(lens.believable(found.lenses), found.lenses)
    held = replace(problem, poses=found.poses, lenses=found.lenses, lens_free=False)
    better = replace(held, poses=adjust(held, replace(settings, steps=60, step_tolerance=1e-9)).poses)
    costs = [adjustment._first_state(one, settings).cost for one in (held, better)]
    assert costs[0] == pytest.approx(costs[1], rel=2e-3)
    assert found.normal.layout.unknowns == 6 * len(truth) + projection.LENS_TERMS


def test_matches_much_worse_than_expected_are_not_believed_about_the_lens() -> None:
    """Four pixels of the feature picture: what the matches alone say lies two to three times as far from the prior."""
    settings, off = AdjustmentSettings(), list[float]()
    for _ in range(4):
        truth = flight(2, 4)
        problem = replace(matches(truth, noise_px=16.0), poses=rough(truth))
        off.append(adjust(problem, settings).lenses[0, 0] - np.log(settings.focal_prior))
    assert np.sqrt(np.mean(np.square(off))) < 0.5 * settings.focal_prior_log_sigma


@pytest.mark.parametrize(
    ("place", "leap", "apart"), [(adjustment.LOG_GSD, -800.0, 500.0), (adjustment.TILT[0], 1.7, 2.0)]
)
def test_a_frame_whose_matches_contradict_each_other_is_not_thrown_out_of_sight(
    monkeypatch: pytest.MonkeyPatch, place: int, leap: float, apart: float
) -> None:
    """Where nothing is seen wrong matches cost less; a scale of nought was the end of the flight, and who looks beyond the
    horizon is led back by no gradient."""
    monkeypatch.setattr(sys.modules[__name__], "RNG", np.random.default_rng(3))
    poses, settings = flight(1, 3), AdjustmentSettings()
    problem = replace(matches(poses, noise_px=1.0), poses=poses)
    of_first = (problem.pairs == 0).any(axis=1)
    wrong = problem.pixels_a.copy()
    wrong[of_first] = RNG.uniform(-apart, apart, wrong[of_first].shape)
    state = adjustment._first_state(replace(problem, pixels_a=wrong), settings)
    step = np.zeros_like(state.gradient)
    step[state.normal.layout.frames[0], place] = leap
    gone = adjustment.stepped(state.problem, state.normal.layout, step)
    assert adjustment._evaluate(gone, settings, state.discounts, state.normal.layout).cost < state.cost
    monkeypatch.setattr(adjustment, "solve", lambda *_: step)
    stays, damping = adjustment._descend(state, settings, 1e-6, map)
    assert stays.steps == state.steps
    assert (stays.problem.poses == state.problem.poses).all()
    assert damping > 1e-6


def test_a_lens_put_back_to_an_ordinary_focal_length_shows_what_it_showed() -> None:
    """Else the little that a long lens bends is a fisheye's in an ordinary one, and frames lose sight of their matches."""
    truth, settings, longer = flight(2, 4), AdjustmentSettings(), 6.4 / CAMERA.focal
    known = np.array([projection.lens_terms(CAMERA)])
    known[:, 0] += np.log(longer)
    known[:, 1:3] *= longer ** np.array([2.0, 4.0])
    state = adjustment._first_state(replace(matches(truth, noise_px=2.0), lenses=known), settings)
    back = adjustment._at_prior(state, settings, adjustment.OPEN_ON_FLAT_GROUND[None])
    assert np.exp(back.problem.lenses[0, 0]) == pytest.approx(settings.focal_prior)
    before, after = (
        one.problem.lenses[0, 1:3] * np.exp(one.problem.lenses[0, 0] * np.array([-2.0, -4.0])) for one in (state, back)
    )
    assert after == pytest.approx(before)
    assert np.isfinite(back.residuals_px[state.problem.present]).all()
