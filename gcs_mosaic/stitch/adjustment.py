"""Joint adjustment of cameras over a plane: bundle adjustment without points.

Unknowns are one pose per frame and one lens (focal length, two radial terms, principal point) per camera. A match of
pixel a in one frame and b in another says that a, taken down to the plane and up into the other frame, should fall on b,
and the other way round. Residuals are measured in the frames (in the plane they would reward a shrinking map). The normal
matrix has one block per frame and per linked pair of frames, so it stays sparse however long the flight is.

The ground is not a plane. A point at an unknown height is seen shifted along its parallax, so a residual counts in full
across that direction and, along it, only as far as it exceeds what the expected heights explain. Across it speaks the
epipolar geometry, which relief cannot bend; along it the plane, which holds the long shape of the map.

Levenberg-Marquardt with iteratively reweighted least squares, after Triggs et al., "Bundle Adjustment - A Modern
Synthesis", 2000; Cauchy loss, because relief gives the residuals heavy tails.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, sparse
from scipy.sparse.linalg import splu

from gcs_mosaic.stitch import projection
from gcs_mosaic.stitch.parallax import whitening
from gcs_mosaic.stitch.projection import LENS_TERMS
from gcs_mosaic.stitch.relief import ReliefSettings

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class AdjustmentSettings:
    """How poses and lenses are estimated from all matches together."""

    matches_per_pair: int = 24  # matches that are used of a pair, well spread; 40 gave the same map
    loss_px: float = 1.0  # Cauchy loss: where a residual begins to count less, in pixels of the feature picture
    focal_prior: float = (
        1.5  # focal length expected of a camera, in half-diagonals: a common field of view (67 degrees across)
    )
    focal_prior_log_sigma: float = 0.3  # how far it may be off, as log: a factor of 1.35
    k1_prior_sigma: float = 0.1  # lenses of aerial cameras are within 0.2
    k2_prior_sigma: float = 0.05  # the second radial term
    shift_prior_sigma: float = 0.02  # principal point off the middle of the frame, half-diagonals
    tilt_prior_sigma: float = 0.1  # radians; weak: what holds the map level where the matches leave it open
    steps: int = 30  # most steps of an adjustment; a warm start needs 2-5
    step_tolerance: float = 3e-4  # relative fall of the cost at which the adjustment is done
    relief: ReliefSettings = field(default_factory=ReliefSettings)


@dataclass(frozen=True, slots=True, kw_only=True)
class Problem:
    """What is adjusted. n frames, c cameras, p linked pairs with up to k matches each.

    Pixels are centred on the frame and divided by its half-diagonal. `unit_px` turns that into pixels of the feature picture.
    """

    poses: Array  # (n, 6)
    lenses: Array  # (c, 5): log focal, k1, k2, shift_x, shift_y
    camera: NDArray[np.intp]  # (n,)
    half_diagonal: Array  # (c,) full-resolution pixels
    unit_px: Array  # (c,)
    pairs: NDArray[np.intp]  # (p, 2) frame indices
    pixels_a: Array  # (p, k, 2)
    pixels_b: Array  # (p, k, 2)
    present: NDArray[np.bool_]  # (p, k)
    free: NDArray[np.bool_]  # (n,) frames that may move
    relief: float = 0.0  # standard deviation of the ground's heights about the plane, canvas units
    lens_free: bool = True


@dataclass(frozen=True, slots=True)
class Solution:
    poses: Array  # (n, 6)
    lenses: Array  # (c, 5)
    residuals_px: Array  # (p, k), the larger of both ways, pixels of the feature picture; NaN where there is no match
    normal: sparse.csc_matrix  # of the free unknowns: six per free frame, then the lenses if they are free
    steps: int


def adjust(problem: Problem, settings: AdjustmentSettings) -> Solution:
    """Best poses and lenses for the matches and the priors."""
    state = _evaluate(problem, settings, _whitenings(problem))
    damping, steps, fall = 1e-4, 0, math.inf
    while steps < settings.steps and fall >= settings.step_tolerance:
        candidate, damping = _descend(state, settings, damping)
        if candidate is None:
            break
        fall = (state.cost - candidate.cost) / max(state.cost, 1e-12)
        state, steps = candidate, steps + 1
    return Solution(state.problem.poses, state.problem.lenses, state.residuals_px, state.normal, steps)


@dataclass(frozen=True, slots=True)
class _State:
    problem: Problem
    whitenings: Array  # (2, m, 2, 2), see `_whitenings`
    cost: float
    normal: sparse.csc_matrix  # over the free unknowns
    gradient: Array
    residuals_px: Array


def _descend(state: _State, settings: AdjustmentSettings, damping: float) -> tuple[_State | None, float]:
    """One accepted step and the damping for the next, or None where no step lowers the cost any more."""
    for _ in range(6):
        step = _solve(state.normal, state.gradient, damping)
        candidate = _evaluate(_stepped(state.problem, step), settings, state.whitenings)
        if candidate.cost < state.cost:
            return candidate, max(damping / 5, 1e-9)
        damping *= 8
    return None, damping


def _solve(normal: sparse.csc_matrix, gradient: Array, damping: float) -> Array:
    """Damped Gauss-Newton step. Unknowns are scaled to a unit diagonal first: canvas units and radians differ by 10^4."""
    scale = 1 / np.sqrt(np.maximum(normal.diagonal(), 1e-12))
    scaling = sparse.diags(scale)
    # What the matches leave open (position, heading, scale of the whole) is held by the damping alone.
    damped = (scaling @ normal @ scaling + sparse.identity(len(scale)) * max(damping, 1e-7)).tocsc()
    if len(gradient) < DENSE_BELOW:
        step = linalg.solve(damped.toarray(), scale * gradient, assume_a="pos", check_finite=False)
    else:
        factor = splu(damped, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
        step = factor.solve(scale * gradient)
    return np.asarray(-scale * step)


DENSE_BELOW = 900  # unknowns up to which the dense factorisation is the faster one


def _unknowns(problem: Problem) -> tuple[NDArray[np.intp], int]:
    """Index of each frame's first unknown, -1 where it is fixed, and the number of pose unknowns."""
    first = np.where(problem.free, 6 * (np.cumsum(problem.free) - 1), -1)
    return first, 6 * int(problem.free.sum())


def _stepped(problem: Problem, step: Array) -> Problem:
    _, pose_unknowns = _unknowns(problem)
    poses, lenses = problem.poses.copy(), problem.lenses.copy()
    poses[problem.free] += step[:pose_unknowns].reshape(-1, 6)
    if problem.lens_free:
        lenses += step[pose_unknowns:].reshape(-1, LENS_TERMS)
    return replace(problem, poses=poses, lenses=lenses)


def _evaluate(problem: Problem, settings: AdjustmentSettings, whitenings: Array) -> _State:
    residual, jacobian, valid = _residuals(problem, whitenings)
    size2 = (residual**2).sum(axis=2) / settings.loss_px**2
    weight = np.where(valid, 1 / (1 + size2), 0.0)
    # A match that cannot be seen any more (behind the horizon) costs as much as a very bad one and pulls nowhere.
    cost = settings.loss_px**2 * np.log1p(np.where(valid, size2, 1e4))[problem.present.repeat(2, axis=1)].sum()
    root = np.sqrt(weight)[:, :, None]
    rows = (residual * root).reshape(len(residual), -1)
    columns = (jacobian * root[..., None]).reshape(len(residual), -1, COLUMNS)
    blocks = columns.transpose(0, 2, 1) @ columns
    slopes = (columns.transpose(0, 2, 1) @ rows[:, :, None])[:, :, 0]
    normal, gradient = _assembled(problem, blocks, slopes)
    prior_cost, prior_normal, prior_gradient = _priors(problem, settings)
    ways = np.sqrt((residual**2).sum(axis=2)).reshape(len(residual), -1, 2).max(axis=2)
    size = np.where(problem.present, np.where(valid.reshape(*ways.shape, 2).all(axis=2), ways, np.inf), np.nan)
    return _State(
        problem, whitenings, float(cost) + prior_cost, normal + sparse.diags(prior_normal, format="csc"),
        gradient + prior_gradient, size,
    )  # fmt: skip


COLUMNS = 2 * (6 + LENS_TERMS)  # unknowns that a pair depends on: pose a, pose b, lens a, lens b


def _residuals(problem: Problem, whitenings: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Residuals (p, 2k, 2), their derivatives (p, 2k, 2, COLUMNS), and which exist (p, 2k).

    The two ways of a match stand side by side: a to b, then b to a.
    """
    p, k = problem.present.shape
    residual, jacobian = np.empty((p, k, 2, 2)), np.zeros((p, k, 2, 2, COLUMNS))
    valid = np.empty((p, k, 2), bool)
    for way, (source, target) in enumerate(((0, 1), (1, 0))):
        passage = _passage(problem, source, target)
        whiten = whitenings[way]
        residual[:, :, way] = (whiten @ passage.residual[:, :, None]).reshape(p, k, 2)
        valid[:, :, way] = passage.valid.reshape(p, k) & problem.present
        for columns, derivative in passage.derivatives:
            jacobian[:, :, way, :, columns] = (whiten @ derivative).reshape(p, k, 2, -1)
    residual, jacobian = np.nan_to_num(residual), np.nan_to_num(jacobian)
    return residual.reshape(p, 2 * k, 2), jacobian.reshape(p, 2 * k, 2, COLUMNS), valid.reshape(p, 2 * k)


@dataclass(frozen=True, slots=True)
class _Passage:
    """All matches taken from one side of their pairs down to the plane and up into the other, (m, ...) in feature pixels."""

    residual: Array  # (m, 2)
    by_height: Array  # (m, 2), of the ground above the plane, per canvas unit
    derivatives: list[tuple[slice, Array]]  # (m, 2, ...) by pose and lens of either side, with their columns
    valid: NDArray[np.bool_]


def _passage(problem: Problem, source: int, target: int) -> _Passage:
    frame_s, frame_t = (problem.pairs[:, side].repeat(problem.present.shape[1]) for side in (source, target))
    pixels = [side.reshape(-1, 2) for side in (problem.pixels_a, problem.pixels_b)]
    down = projection.canvas_from_pixels(*_of(problem, frame_s), pixels[source])
    up = projection.pixels_from_canvas(*_of(problem, frame_t), down.points)
    unit = problem.unit_px[problem.camera[frame_t]][:, None]
    by_place = up.by_point * unit[:, :, None]
    poses, lenses = (slice(0, 6), slice(6, 12)), (slice(12, 12 + LENS_TERMS), slice(12 + LENS_TERMS, COLUMNS))
    return _Passage(
        residual=(up.points - pixels[target]) * unit,
        by_height=(by_place @ down.by_height[:, :, None])[:, :, 0] + up.by_height * unit,
        derivatives=[
            (poses[source], by_place @ down.by_pose),
            (lenses[source], by_place @ down.by_lens),
            (poses[target], up.by_pose * unit[:, :, None]),
            (lenses[target], up.by_lens * unit[:, :, None]),
        ],
        valid=down.valid & up.valid,
    )


def _whitenings(problem: Problem) -> Array:
    """What makes the residuals of all matches comparable, for either way (2, m, 2, 2), from the poses as they are.

    They hold for the whole adjustment. If they followed the poses, the cost could be lowered by poses that allow more
    parallax, and steps, which know nothing of that, would end where they do not lower it.
    """
    return np.stack([whitening(_passage(problem, *way).by_height * problem.relief) for way in ((0, 1), (1, 0))])


def _of(problem: Problem, frames: NDArray[np.intp]) -> tuple[Array, Array, Array]:
    camera = problem.camera[frames]
    return problem.poses[frames], problem.lenses[camera], problem.half_diagonal[camera]


def _assembled(problem: Problem, blocks: Array, slopes: Array) -> tuple[sparse.csc_matrix, Array]:
    """Normal matrix and gradient over the free unknowns from one block and slope (COLUMNS) per pair."""
    first, pose_unknowns = _unknowns(problem)
    size = pose_unknowns + (LENS_TERMS * len(problem.lenses) if problem.lens_free else 0)
    index = np.full((len(problem.pairs), COLUMNS), -1)
    for side in (0, 1):
        frame = problem.pairs[:, side]
        moves = problem.free[frame]
        index[moves, 6 * side : 6 * side + 6] = first[frame[moves], None] + np.arange(6)
        if problem.lens_free:
            lens = pose_unknowns + LENS_TERMS * problem.camera[frame]
            begin = 12 + LENS_TERMS * side
            index[:, begin : begin + LENS_TERMS] = lens[:, None] + np.arange(LENS_TERMS)
    rows, columns = np.broadcast_arrays(index[:, :, None], index[:, None, :])
    kept = (rows >= 0) & (columns >= 0)
    normal = sparse.coo_matrix((blocks[kept], (rows[kept], columns[kept])), shape=(size, size)).tocsc()
    gradient = np.bincount(index[index >= 0], weights=slopes[index >= 0], minlength=size)
    return normal, np.asarray(gradient, dtype=np.float64)


def _priors(problem: Problem, settings: AdjustmentSettings) -> tuple[float, Array, Array]:
    """Cost, diagonal and gradient of what is believed before any match: nearly level flight, an ordinary lens."""
    tilt = problem.poses[problem.free, 4:] / settings.tilt_prior_sigma
    # Cauchy again: a frame that really is oblique must be allowed to be.
    tilt_size2 = (tilt**2).sum(axis=1) / TILT_PRIOR_REACH**2
    tilt_weight = 1 / (1 + tilt_size2[:, None])
    diagonal, gradient = np.zeros((len(tilt), 6)), np.zeros((len(tilt), 6))
    diagonal[:, 4:] = tilt_weight / settings.tilt_prior_sigma**2
    gradient[:, 4:] = tilt_weight * tilt / settings.tilt_prior_sigma
    cost = TILT_PRIOR_REACH**2 * np.log1p(tilt_size2).sum()
    if not problem.lens_free:
        return float(cost), diagonal.ravel(), gradient.ravel()
    shift = settings.shift_prior_sigma
    sigma = np.array([settings.focal_prior_log_sigma, settings.k1_prior_sigma, settings.k2_prior_sigma, shift, shift])
    lens = (problem.lenses - [np.log(settings.focal_prior), 0.0, 0.0, 0.0, 0.0]) / sigma
    cost += (lens**2).sum()
    return (
        float(cost),
        np.concatenate([diagonal.ravel(), np.broadcast_to(1 / sigma**2, lens.shape).ravel()]),
        np.concatenate([gradient.ravel(), (lens / sigma).ravel()]),
    )


TILT_PRIOR_REACH = 3.0  # sigmas within which the tilt prior is quadratic
