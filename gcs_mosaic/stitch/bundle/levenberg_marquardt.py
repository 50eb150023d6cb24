"""Bundle adjustment of cameras over a plane, without points.

Unknowns are one pose per frame and one lens (focal length, two radial terms, principal point) per camera. A match of pixel a in
one frame and b in another states that a, projected to the plane and into the other frame, should coincide with b, and vice
versa. Residuals are measured in the frames (in the plane they would reward a shrinking map). The normal matrix has one block
per frame and per linked pair, so it stays sparse however long the flight is.

Levenberg-Marquardt with iteratively reweighted least squares, after Triggs et al., "Bundle Adjustment - A Modern Synthesis",
2000; Cauchy loss, because relief gives the residuals heavy tails.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from gcs_mosaic.stitch.arrays import Array, LensesNx5, Matrix, PairValues, PosesNx6, Vector
from gcs_mosaic.stitch.bundle.lens import believable
from gcs_mosaic.stitch.bundle.normal_equations import EquationLayout, Normal, Run, add_pairs, blank, layout_of, solve
from gcs_mosaic.stitch.bundle.problem import Problem
from gcs_mosaic.stitch.bundle.residuals import PAIRS_AT_ONCE, discounts_of, parts, weighed
from gcs_mosaic.stitch.camera.projection import LENS_TERMS
from gcs_mosaic.stitch.camera.relief import ReliefSettings


@dataclass(frozen=True, slots=True, kw_only=True)
class AdjustmentSettings:
    """Bundle adjustment of poses and lenses."""

    matches_per_pair: int = 24  # matches used per pair, well spread; 40 gave the same map
    loss_px: float = 1.0  # Cauchy loss scale, in pixels of the feature picture
    # focal length expected of a camera, in half-diagonals: a common field of view (67 degrees across)
    focal_prior: float = 1.5
    focal_prior_log_sigma: float = 0.3  # its standard deviation, as log: a factor of 1.35
    k1_prior_sigma: float = 0.1  # lenses of aerial cameras are within 0.2
    k2_prior_sigma: float = 0.05  # the second radial term
    shift_prior_sigma: float = 0.02  # offset of the principal point from the frame's centre, half-diagonals
    tilt_prior_sigma: float = 0.1  # radians; weak: keeps the map level where the matches leave its tilt open
    steps: int = 30  # maximum steps of an adjustment; a warm start needs 2-5
    step_tolerance: float = 3e-4  # relative decrease of the cost at which the adjustment has converged
    relief: ReliefSettings = field(default_factory=ReliefSettings)


@dataclass(frozen=True, slots=True)
class Solution:
    poses: PosesNx6  # (n, 6)
    lenses: LensesNx5  # (c, 5)
    residuals_px: PairValues  # the larger of both directions, pixels of the feature picture; NaN without a match
    normal: Normal  # of the free unknowns
    steps: int


def adjust(problem: Problem, settings: AdjustmentSettings, run: Run = map) -> Solution:
    """Best poses and lenses for the matches and the priors; `run` as in `solve`.

    Model errors of more than a pixel (woods, rolling shutters) are correlated within a pair's matches, and a lens would follow
    them: the larger the final residuals, the firmer the lens prior, and everything is adjusted once more.
    """
    state = _converged(_first_state(problem, settings), settings, run)
    excess = _excess(state)
    if problem.lens_free and excess > 1:
        state = _converged(_with_firmer_lens_prior(state, settings, excess), settings, run)
    return Solution(state.problem.poses, state.problem.lenses, state.residuals_px, state.normal, state.steps)


def _converged(state: _State, settings: AdjustmentSettings, run: Run) -> _State:
    """Iterate until no step lowers the cost.

    A step that leaves the lens limits was computed for that lens; with the clipped lens it lowers nothing and the poses would
    stall. So the poses then continue alone.
    """
    state = _descended(state, settings, run)
    if not state.stopped_lens:
        return state
    problem = replace(state.problem, lens_free=False)
    held = _evaluate(problem, settings, state.discounts, layout_of(problem))
    held = _descended(replace(held, steps=state.steps), settings, run)
    found = _evaluate(replace(held.problem, lens_free=True), settings, state.discounts, state.normal.layout)
    return replace(found, steps=held.steps)


def _descended(state: _State, settings: AdjustmentSettings, run: Run) -> _State:
    damping, most, fall = 1e-4, state.steps + settings.steps, math.inf
    while state.steps < most and fall >= settings.step_tolerance:
        before = state
        state, damping = _descend(before, settings, damping, run)
        if state.steps == before.steps:
            break
        fall = (before.cost - state.cost) / max(before.cost, 1e-12)
    return state


def any_lens(settings: AdjustmentSettings) -> tuple[Vector, Vector]:
    """Prior mean and standard deviation of an unknown lens, (5,) each."""
    shift = settings.shift_prior_sigma
    sigma = [settings.focal_prior_log_sigma, settings.k1_prior_sigma, settings.k2_prior_sigma, shift, shift]
    return np.array([np.log(settings.focal_prior), 0.0, 0.0, 0.0, 0.0]), np.array(sigma)


def _first_state(problem: Problem, settings: AdjustmentSettings) -> _State:
    """Initial state, with the lens priors filled in."""
    if problem.lens_prior is None:
        mean, sigma = (np.tile(row, (len(problem.lenses), 1)) for row in any_lens(settings))
        problem = replace(problem, lens_prior=np.stack([mean, sigma]))
    return _evaluate(problem, settings, [discounts_of(part) for part in parts(problem)], layout_of(problem))


def _excess(state: _State) -> float:
    """Median squared residual relative to that of one-pixel noise."""
    size2 = state.residuals_px[np.isfinite(state.residuals_px)] ** 2
    return min(float(np.median(size2)) / EXPECTED_SIZE2, MOST_EXCESS) if len(size2) else 1.0


def _with_firmer_lens_prior(state: _State, settings: AdjustmentSettings, excess: float) -> _State:
    assert state.problem.lens_prior is not None, "the first state fills it in"
    mean, sigma = state.problem.lens_prior
    firmer = replace(state.problem, lens_prior=np.stack([mean, sigma / math.sqrt(excess)]))
    return replace(_evaluate(firmer, settings, state.discounts, state.normal.layout), steps=state.steps)


EXPECTED_SIZE2 = 2 * math.log(2)  # median squared norm of a residual with one pixel deviation per component
MOST_EXCESS = 25.0  # relative to that; more indicates wrong matches, not model errors


@dataclass(frozen=True, slots=True)
class _State:
    problem: Problem
    discounts: list[Array]  # of each of its parts; fixed for the whole adjustment, see `residuals.discounts_of`
    cost: float
    normal: Normal  # over the free unknowns
    gradient: Matrix  # (v, BLOCK), by vertex
    residuals_px: PairValues
    steps: int = 0  # number of steps so far
    stopped_lens: bool = False  # whether the last step, or those rejected since, left the lens limits


def _descend(state: _State, settings: AdjustmentSettings, damping: float, run: Run) -> tuple[_State, float]:
    """The state after one accepted step, or unchanged if no step lowers the cost, and the next damping."""
    stopped = False
    for _ in range(6):
        step = solve(state.normal, state.gradient, damping, run)
        if step is not None:
            problem = _stepped(state.problem, state.normal.layout, step)
            lenses = _lenses_after(state.problem, state.normal.layout, step)
            stopped |= not np.array_equal(problem.lenses, lenses)
            candidate = _evaluate(problem, settings, state.discounts, state.normal.layout)
            if candidate.cost < state.cost:
                return replace(candidate, steps=state.steps + 1, stopped_lens=stopped), max(damping / 5, 1e-9)
        damping *= 8
    return replace(state, stopped_lens=stopped), damping


def _stepped(problem: Problem, layout: EquationLayout, step: Matrix) -> Problem:
    """The problem after a step (v, BLOCK), with lenses that a camera can have."""
    poses, lenses = problem.poses.copy(), _lenses_after(problem, layout, step)
    poses[problem.free] += step[layout.frames[problem.free]]
    return replace(problem, poses=poses, lenses=believable(lenses) if problem.lens_free else lenses)


def _lenses_after(problem: Problem, layout: EquationLayout, step: Matrix) -> LensesNx5:
    """The lenses (c, 5) after a step, before clipping to the limits."""
    return problem.lenses + step[layout.lenses, :LENS_TERMS] if problem.lens_free else problem.lenses


def _evaluate(problem: Problem, settings: AdjustmentSettings, by_part: list[Array], layout: EquationLayout) -> _State:
    """Cost, derivatives and residuals, part by part: only sums of the derivatives are held."""
    normal, gradient = blank(layout)
    cost = _add_priors(problem, settings, normal, gradient)
    residuals_px = np.empty(problem.present.shape)
    for number, (part, discounts) in enumerate(zip(parts(problem), by_part, strict=True)):
        pairs = slice(number * PAIRS_AT_ONCE, (number + 1) * PAIRS_AT_ONCE)
        some = weighed(part, discounts, settings.loss_px)
        add_pairs(normal, gradient, pairs, some.blocks, some.slopes)
        residuals_px[pairs] = some.residuals_px
        cost += some.cost
    return _State(problem, by_part, cost, normal, gradient, residuals_px)


def _add_priors(problem: Problem, settings: AdjustmentSettings, normal: Normal, gradient: Matrix) -> float:
    """Add the priors to normal matrix and gradient: nearly level flight, an ordinary lens. Returns their cost."""
    frames, lenses = normal.layout.frames[problem.free], normal.layout.lenses
    tilt = problem.poses[problem.free, 4:] / settings.tilt_prior_sigma
    # Cauchy again: a truly oblique frame must be possible.
    tilt_size2 = (tilt**2).sum(axis=1) / TILT_PRIOR_REACH**2
    tilt_weight = 1 / (1 + tilt_size2[:, None])
    normal.blocks[frames[:, None], TILT, TILT] += tilt_weight / settings.tilt_prior_sigma**2
    gradient[frames[:, None], TILT] += tilt_weight * tilt / settings.tilt_prior_sigma
    cost = TILT_PRIOR_REACH**2 * np.log1p(tilt_size2).sum()
    if problem.lens_free:
        assert problem.lens_prior is not None, "the first state fills it in"
        mean, sigma = problem.lens_prior
        lens, terms = (problem.lenses - mean) / sigma, np.arange(LENS_TERMS)
        normal.blocks[lenses[:, None], terms, terms] += 1 / sigma**2
        gradient[lenses[:, None], terms] += lens / sigma
        cost += (lens**2).sum()
    return float(cost)


TILT = np.array([4, 5])  # places of pitch and roll in a pose
TILT_PRIOR_REACH = 3.0  # standard deviations within which the tilt prior is quadratic
