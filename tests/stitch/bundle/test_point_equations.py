"""The reduced equations are those of the cost from which the points have been eliminated."""

from dataclasses import replace

import numpy as np
import pytest
from sighted_hills import HEIGHT, hill, sighted, survey

from gcs_mosaic.stitch.arrays import Array
from gcs_mosaic.stitch.bundle.levenberg_marquardt import AdjustmentSettings, stepped
from gcs_mosaic.stitch.bundle.point_equations import (
    HeightPrior,
    PointEquations,
    PointState,
    flying_height,
    point_layout,
)
from gcs_mosaic.stitch.bundle.problem import Problem

SETTINGS = AdjustmentSettings()


def equations(seed: int) -> tuple[PointEquations, PointState]:
    """Of a few frames over a hill, a little off their true poses, with points where these see them best."""
    truth = survey(seed, lines=2, per_line=3)
    problem, seen, points = sighted(truth, hill, seed, points=150)
    weights = np.eye(5)[None] / problem.lens_prior[1][:, None] ** 2 if problem.lens_prior is not None else None
    rng = np.random.default_rng(seed)
    off = rng.normal(0, 1, truth.shape) * np.array([0.0005 * HEIGHT, 0.0005 * HEIGHT, 0.0005, 0.0005, 0.0005, 0.0005])
    problem = replace(problem, poses=truth + off, lens_weights=weights)
    made = PointEquations(point_layout(problem, seen), seen, SETTINGS, map)
    prior = HeightPrior(0.1, np.ones(len(points)))
    return made, made.at(problem, made.settled(problem, points, prior, 100), prior)


def test_the_gradient_is_that_of_the_cost_with_points_where_they_fit_best() -> None:
    made, state = equations(1)
    rng, layout = np.random.default_rng(0), made.layout.equations
    scale = np.tile([HEIGHT, HEIGHT, 1, 1, 1, 1], (layout.vertices, 1)) * 1e-6
    scale[layout.lenses] = [1e-6] * 5 + [0.0]
    for _ in range(5):
        step = rng.normal(0, 1, scale.shape) * scale
        problems = (straight(state.problem, made, sign * step) for sign in (1, -1))
        # The points fit best, so to first order their own moves cost nothing.
        ahead, behind = (made.at(problem, state.points, state.prior).cost for problem in problems)
        assert (ahead - behind) / 2 == pytest.approx(2 * float((state.gradient * step).sum()), rel=2e-2)


def straight(problem: Problem, made: PointEquations, step: Array) -> Problem:
    """The problem after a step, without what makes it follow flat ground."""
    layout = made.layout.equations
    poses, lenses = problem.poses + step[layout.frames], problem.lenses + step[layout.lenses, :5]
    return replace(problem, poses=poses, lenses=lenses)


def test_a_map_of_another_scale_costs_as_much() -> None:
    made, state = equations(2)
    poses = state.problem.poses * [3, 3, 1, 1, 1, 1] + [0, 0, np.log(3), 0, 0, 0]
    larger = made.at(replace(state.problem, poses=poses), 3 * state.points, state.prior)
    assert larger.cost == pytest.approx(state.cost, rel=1e-9)
    assert flying_height(larger.problem) == pytest.approx(3 * flying_height(state.problem))


def test_a_step_moves_points_as_it_moves_what_sees_them() -> None:
    made, state = equations(3)
    step = np.zeros_like(state.gradient)
    step[made.layout.equations.frames, 0] = 1e-3 * HEIGHT  # all cameras to the right
    moved = state.points_after(made.layout, step) - state.points_after(made.layout, np.zeros_like(step))
    assert np.abs(moved - [1e-3 * HEIGHT, 0, 0]).max() < 1e-5 * HEIGHT
    assert stepped(state.problem, made.layout.equations, step).poses[0, 0] > state.problem.poses[0, 0]
