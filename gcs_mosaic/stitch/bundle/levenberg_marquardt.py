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

from gcs_mosaic.stitch.arrays import (
    Array,
    LensesNx5,
    Mask,
    Matrices,
    Matrix,
    PairValues,
    PosesNx6,
    Vector,
)
from gcs_mosaic.stitch.bundle.flat_ground import along_flat_ground
from gcs_mosaic.stitch.bundle.lens import believable, focal_spread
from gcs_mosaic.stitch.bundle.normal_equations import EquationLayout, Normal, Run, add_pairs, blank, layout_of, solve
from gcs_mosaic.stitch.bundle.problem import Problem
from gcs_mosaic.stitch.bundle.residuals import PAIRS_AT_ONCE, discounts_of, parts, slopes_by_unmodelled, weighed
from gcs_mosaic.stitch.bundle.self_calibration import LensEvidence, Slopes, lens_evidence
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
    # (c, 5, 5) of the free lenses' terms, whatever their errors have in common; None if the matches leave one open
    lens_covariances: Matrices | None
    refused: Mask  # (c,) lenses that matches pulled to where none is believed: terms were held at the prior


def adjust(problem: Problem, settings: AdjustmentSettings, run: Run = map) -> Solution:
    """Best poses and lenses for the matches and the priors; `run` as in `solve`.

    Model errors (relief, woods, rolling shutters) are correlated within the matches of a pair and of a frame, and a lens would
    follow them: the more they pull one way, see `self_calibration`, and the larger the final residuals, the firmer the lens
    prior, and everything is adjusted once more.
    """
    state = _converged(_first_state(problem, settings), settings, run)
    if not problem.lens_free:
        return _solution(state, None, np.zeros(len(problem.lenses), bool))
    evidence = _evidence(state, settings, run)
    if evidence is not None:
        state, evidence = _firmer(state, evidence, settings, run)
    state, refused = _within_limits(state, settings, run)
    evidence = evidence if evidence is None or not refused.any() else _evidence(state, settings, run)
    doubtful = _doubtful(state, evidence, settings)
    if doubtful.any():
        state = _converged(_at_prior(state, settings, doubtful), settings, run)
        evidence = _evidence(state, settings, run)
    covariances = None if evidence is None else _lens_covariances(state, evidence, settings)
    return _solution(state, covariances, refused | doubtful.any(axis=1))


def cost_of(problem: Problem, solution: Solution, settings: AdjustmentSettings) -> float:
    """What a problem costs as solved, by its own priors: of two solutions the one that costs less is likelier."""
    return _first_state(replace(problem, poses=solution.poses, lenses=solution.lenses), settings).cost


def _solution(state: _State, lens_covariances: Matrices | None, refused: Mask) -> Solution:
    problem = state.problem
    return Solution(
        problem.poses, problem.lenses, state.residuals_px, state.normal, state.steps, lens_covariances, refused
    )


def _evidence(state: _State, settings: AdjustmentSettings, run: Run) -> LensEvidence | None:
    """Evidence of the lenses, doubted at least as the residuals tell: the more, the larger they are."""
    batches = zip(parts(state.problem), state.discounts, strict=True)
    slopes = (_slopes(part, discounts, settings.loss_px) for part, discounts in batches)
    sigma = _lens_prior(state)[1]
    found = lens_evidence(state.problem, state.normal, slopes, state.residuals_px / settings.loss_px, sigma, run)
    return None if found is None else replace(found, doubt=np.maximum(found.doubt, _excess(state)))


def _slopes(part: Problem, discounts: Array, loss_px: float) -> Slopes:
    return Slopes(weighed(part, discounts, loss_px).slopes, slopes_by_unmodelled(part, discounts, loss_px))


def _firmer(
    state: _State, evidence: LensEvidence, settings: AdjustmentSettings, run: Run
) -> tuple[_State, LensEvidence | None]:
    """The state adjusted with lens priors as firm as the evidence asks for, and its evidence, unless that moves no lens by more
    than a tenth of its deviation."""
    problem, (mean, sigma), weights = state.problem, _lens_prior(state), evidence.prior_weights
    pull = (weights - _lens_weights(state)) @ (mean - problem.lenses)[:, :, None]
    moved = np.linalg.solve(evidence.of_matches + weights, pull)
    if (moved.transpose(0, 2, 1) @ np.linalg.solve(evidence.covariance(weights, sigma), moved) < LITTLE_MOVED**2).all():
        return state, evidence
    firmer = replace(problem, lens_weights=weights)
    firmer_state = replace(_evaluate(firmer, settings, state.discounts, state.normal.layout), steps=state.steps)
    found = _converged(firmer_state, settings, run)
    return found, _evidence(found, settings, run)


def _within_limits(state: _State, settings: AdjustmentSettings, run: Run) -> tuple[_State, Mask]:
    """The state without lenses that matches pull to the limits of what a lens can be, and which those were, (c,).

    No such lens is believed: the terms that flat ground leaves open then stay at the prior, and the distortion as well if it
    still leaves the limits.
    """
    refused = np.zeros(len(state.problem.lenses), bool)
    for terms in (OPEN_ON_FLAT_GROUND, np.ones(LENS_TERMS, bool)):
        beyond = state.stopped_lenses
        if not beyond.any():
            break
        refused |= beyond
        state = _converged(_at_prior(state, settings, beyond[:, None] & terms), settings, run)
    return state, refused


def _doubtful(state: _State, evidence: LensEvidence | None, settings: AdjustmentSettings) -> Mask:
    """Terms (c, 5) far from the prior though less well known than by it: what pulls there is no lens.

    On flat ground the squeeze of tilted views measures the square of the focal length, with one deviation for all: a long one
    seems known to a small share of it where nothing would be known of an ordinary one.
    """
    mean, sigma = _lens_prior(state)
    if evidence is None:
        return np.zeros(mean.shape, bool)
    deviation = np.sqrt(np.diagonal(_lens_covariances(state, evidence, settings), axis1=1, axis2=2))
    deviation[:, 0] *= np.exp(2 * np.maximum(state.problem.lenses - mean, 0.0)[:, 0])
    far = abs(state.problem.lenses - mean) > FAR * sigma
    return np.asarray(OPEN_ON_FLAT_GROUND & far & (deviation > sigma))


def _at_prior(state: _State, settings: AdjustmentSettings, terms: Mask) -> _State:
    """The state with these terms (c, 5) of the lenses at their prior and held there.

    What matches determine on flat ground is tilt over focal length, so tilts change with it; and how far pixels are displaced,
    so the distortion, which is told by angles, does as well.
    """
    problem, (mean, sigma) = state.problem, _lens_prior(state)
    shorter = np.where(terms, mean, problem.lenses)[:, :1] - problem.lenses[:, :1]
    as_seen = problem.lenses.copy()
    as_seen[:, 1:3] *= np.exp(shorter * DEGREES)
    lenses = believable(np.where(terms, mean, as_seen), problem.fisheye)
    weights = _lens_weights(state) + np.eye(LENS_TERMS) * np.where(terms, HELD / sigma**2, 0.0)[:, None]
    poses = problem.poses.copy()
    poses[problem.free, 4:] *= np.exp(lenses[:, 0] - problem.lenses[:, 0])[problem.camera[problem.free], None]
    problem = replace(problem, poses=poses, lenses=lenses, lens_weights=weights)
    return replace(_evaluate(problem, settings, state.discounts, state.normal.layout), steps=state.steps)


def _lens_covariances(state: _State, evidence: LensEvidence, settings: AdjustmentSettings) -> Matrices:
    """Covariances (c, 5, 5) of the lenses' terms: from what the matches and the prior leave open."""
    spread = _lens_prior(state)[1].copy()
    spread[:, 0] = focal_spread(spread[:, 0], settings.focal_prior_log_sigma)
    return evidence.covariance(_lens_weights(state), spread)


def _lens_prior(state: _State) -> Array:
    assert state.problem.lens_prior is not None, "the first state fills it in"
    return state.problem.lens_prior


def _lens_weights(state: _State) -> Matrices:
    assert state.problem.lens_weights is not None, "the first state fills them in"
    return state.problem.lens_weights


LITTLE_MOVED = 0.1  # standard deviations of a lens; half or twice as much gives the same map
OPEN_ON_FLAT_GROUND = np.array([True, False, False, True, True])  # of a lens' terms: focal length and principal point
DEGREES = np.array([2.0, 4.0])  # of the radial terms, in the tangent of the angle
FAR = 2.0  # standard deviations of the prior
HELD = 1e6  # weight of a prior that holds a term, relative to its own


def _converged(state: _State, settings: AdjustmentSettings, run: Run) -> _State:
    """Iterate until no step lowers the cost.

    A step that leaves the lens limits was computed for that lens; with the clipped lens it lowers nothing and the poses would
    stall. So the poses then continue alone.
    """
    state = _descended(state, settings, run)
    if not state.stopped_lenses.any():
        return state
    problem = replace(state.problem, lens_free=False)
    held = _evaluate(problem, settings, state.discounts, layout_of(problem))
    held = _descended(replace(held, steps=state.steps), settings, run)
    found = _evaluate(replace(held.problem, lens_free=True), settings, state.discounts, state.normal.layout)
    return replace(found, steps=held.steps, stopped_lenses=state.stopped_lenses)


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
    if problem.lens_weights is None:
        assert problem.lens_prior is not None, "just filled in"
        problem = replace(problem, lens_weights=np.eye(LENS_TERMS) / problem.lens_prior[1][:, None] ** 2)
    return _evaluate(problem, settings, [discounts_of(part) for part in parts(problem)], layout_of(problem))


def _excess(state: _State) -> float:
    """Median squared residual relative to that of one-pixel noise."""
    size2 = state.residuals_px[np.isfinite(state.residuals_px)] ** 2
    return min(float(np.median(size2)) / EXPECTED_SIZE2, MOST_EXCESS) if len(size2) else 1.0


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
    # (c,) whether the last step, or those rejected since, left the limits of a lens
    stopped_lenses: Mask = field(default_factory=lambda: np.zeros(1, bool))


def _descend(state: _State, settings: AdjustmentSettings, damping: float, run: Run) -> tuple[_State, float]:
    """The state after one accepted step, or unchanged if no step lowers the cost, and the next damping."""
    stopped = np.zeros(len(state.problem.lenses), bool)
    for _ in range(6):
        step = solve(state.normal, state.gradient, damping, run)
        if step is not None:
            problem = stepped(state.problem, state.normal.layout, step)
            lenses = lenses_after(state.problem, state.normal.layout, step)
            stopped |= (problem.lenses != lenses).any(axis=1)
            problem = without_leaps(problem, state.problem.poses)
            candidate = _evaluate(problem, settings, state.discounts, state.normal.layout)
            candidate = _with_frames_held(candidate, state, settings)
            if candidate.cost < state.cost and not _turned_away(candidate, state).any():
                return replace(candidate, steps=state.steps + 1, stopped_lenses=stopped), max(damping / 5, 1e-9)
        damping *= 8
    return replace(state, stopped_lenses=stopped), damping


def _with_frames_held(candidate: _State, before: _State, settings: AdjustmentSettings) -> _State:
    """The state after a step, with frames that it turns away where they were: they do not keep the others from being adjusted."""
    away = _turned_away(candidate, before)
    if not away.any():
        return candidate
    poses = np.where(away[:, None], before.problem.poses, candidate.problem.poses)
    return _evaluate(replace(candidate.problem, poses=poses), settings, before.discounts, before.normal.layout)


def _turned_away(after: _State, before: _State) -> Mask:
    """Frames (n,) that a step leaves with most of their matches where nothing is seen, beyond a horizon or where a lens folds: no
    gradient leads back from there."""
    return _sees_nothing(after) & ~_sees_nothing(before)


def _sees_nothing(state: _State) -> Mask:
    problem = state.problem
    of_pairs = np.isinf(state.residuals_px).sum(axis=1), problem.present.sum(axis=1)
    lost, all_of_them = (np.bincount(problem.pairs.ravel(), ones.repeat(2), len(problem.poses)) for ones in of_pairs)
    return np.asarray(lost > all_of_them / 2)


LOG_GSD = 2  # place in a pose
# Of a frame's scale in one step, as log. What a frame does not see any more costs no more than matches 100 px off, so one whose
# matches contradict each other by more would be thrown out of sight. Steps of four real flights change it by 0.07 at most.
MOST_ZOOM = 1.0


def without_leaps(problem: Problem, before: PosesNx6) -> Problem:
    """The problem after a step, with frames that leap where they were (n, 6): they do not keep the others from being adjusted."""
    leaps = abs(problem.poses - before)[:, LOG_GSD] > MOST_ZOOM
    return replace(problem, poses=np.where(leaps[:, None], before, problem.poses)) if leaps.any() else problem


def stepped(problem: Problem, layout: EquationLayout, step: Matrix) -> Problem:
    """The problem after a step (v, BLOCK), with lenses that a camera can have."""
    poses, lenses = problem.poses.copy(), lenses_after(problem, layout, step)
    of_frames = step[layout.frames[problem.free]]
    poses[problem.free] += of_frames
    if not problem.lens_free:
        return replace(problem, poses=poses, lenses=lenses)
    lenses, camera = believable(lenses, problem.fisheye), problem.camera[problem.free]
    focal = problem.lenses[camera, 0], lenses[camera, 0]
    half_diagonals = problem.half_diagonal[camera]
    poses[problem.free] += along_flat_ground(problem.poses[problem.free], of_frames, *focal, half_diagonals)
    return replace(problem, poses=poses, lenses=lenses)


def lenses_after(problem: Problem, layout: EquationLayout, step: Matrix) -> LensesNx5:
    """The lenses (c, 5) after a step, before clipping to the limits."""
    return problem.lenses + step[layout.lenses, :LENS_TERMS] if problem.lens_free else problem.lenses


def _evaluate(problem: Problem, settings: AdjustmentSettings, by_part: list[Array], layout: EquationLayout) -> _State:
    """Cost, derivatives and residuals, part by part: only sums of the derivatives are held."""
    normal, gradient = blank(layout)
    cost = add_priors(problem, settings, normal, gradient)
    residuals_px = np.empty(problem.present.shape)
    for number, (part, discounts) in enumerate(zip(parts(problem), by_part, strict=True)):
        pairs = slice(number * PAIRS_AT_ONCE, (number + 1) * PAIRS_AT_ONCE)
        some = weighed(part, discounts, settings.loss_px)
        add_pairs(normal, gradient, pairs, some.blocks, some.slopes)
        residuals_px[pairs] = some.residuals_px
        cost += some.cost
    return _State(problem, by_part, cost, normal, gradient, residuals_px)


def add_priors(problem: Problem, settings: AdjustmentSettings, normal: Normal, gradient: Matrix) -> float:
    """Add the priors to normal matrix and gradient: nearly level flight, an ordinary lens. Returns their cost."""
    cost = _add_tilt_prior(problem, settings, normal, gradient)
    return cost + _add_lens_prior(problem, normal, gradient) if problem.lens_free else cost


def _add_tilt_prior(problem: Problem, settings: AdjustmentSettings, normal: Normal, gradient: Matrix) -> float:
    """The prior of nearly level flight, or of the tilts that are expected instead.

    Near-nadir views of flat ground determine each tilt over the focal length, hardly either. A prior of the tilts alone would,
    with the number of frames, pull the focal length down ever more strongly; so their deviation follows the focal length.
    """
    layout, camera = normal.layout, problem.camera[problem.free]
    frames, lenses = layout.frames[problem.free], layout.lenses[camera]
    sigma = settings.tilt_prior_sigma * np.exp(problem.lenses[camera, 0]) / settings.focal_prior
    expected = 0.0 if problem.tilt_prior is None else problem.tilt_prior[camera]
    tilt = (problem.poses[problem.free, 4:] - expected) / sigma[:, None]
    # Cauchy again: a truly oblique frame must be possible.
    tilt_size2 = (tilt**2).sum(axis=1) / TILT_PRIOR_REACH**2
    weight = 1 / (1 + tilt_size2)
    normal.blocks[frames[:, None], TILT, TILT] += (weight / sigma**2)[:, None]
    gradient[frames[:, None], TILT] += weight[:, None] * tilt / sigma[:, None]
    if problem.lens_free:
        along = weight * (tilt**2).sum(axis=1)
        of_lenses = np.bincount(camera, along, len(problem.lenses))
        normal.blocks[layout.lenses, 0, 0] += of_lenses
        gradient[layout.lenses, 0] -= of_lenses
        normal.blocks[layout.edges_between(frames, lenses)[:, None], TILT, 0] -= weight[:, None] * tilt / sigma[:, None]
    return float(TILT_PRIOR_REACH**2 * np.log1p(tilt_size2).sum())


def _add_lens_prior(problem: Problem, normal: Normal, gradient: Matrix) -> float:
    assert problem.lens_prior is not None, "the first state fills it in"
    assert problem.lens_weights is not None, "the first state fills them in"
    lenses, terms, off = normal.layout.lenses, np.arange(LENS_TERMS), problem.lenses - problem.lens_prior[0]
    slope = (problem.lens_weights @ off[:, :, None])[:, :, 0]
    normal.blocks[lenses[:, None, None], terms[:, None], terms] += problem.lens_weights
    gradient[lenses[:, None], terms] += slope
    return float((off * slope).sum())


TILT = np.array([4, 5])  # places of pitch and roll in a pose
TILT_PRIOR_REACH = 3.0  # standard deviations within which the tilt prior is quadratic
