"""Uncertainty of frame positions: standard deviations from the covariance of an adjustment.

They are relative to the island's first frame, its root: position, heading and scale of the root's image are fixed (a choice of
gauge, which the matches do not determine; see Triggs et al., "Bundle Adjustment - A Modern Synthesis", 2000, section 9). They
propagate match noise. Errors outside the model, relief above all, enter only as far as they show in the residuals; those of
lenses are stated with what such errors have in common, see `self_calibration`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gcs_mosaic.stitch.arrays import Array, Indices, Matrices, PairValues, SquareMatrix, Vector
from gcs_mosaic.stitch.bundle.elimination import BLOCK
from gcs_mosaic.stitch.bundle.levenberg_marquardt import Solution
from gcs_mosaic.stitch.bundle.normal_equations import Normal, Run
from gcs_mosaic.stitch.bundle.problem import POSE, Problem
from gcs_mosaic.stitch.bundle.selected_inverse import Covariances, covariances
from gcs_mosaic.stitch.camera import projection
from gcs_mosaic.stitch.camera.geometry import Camera
from gcs_mosaic.stitch.camera.projection import LENS_TERMS

GAUGE = 4  # the first four of these: position, scale and heading
WAYS = 2  # a match enters the normal matrix in both directions, a to b and b to a, but is one measurement


@dataclass(frozen=True, slots=True)
class IslandCertainty:
    """Uncertainty of n adjusted frames: `deviations_px` (n,), standard deviation of each frame's least certain corner in pixels
    of the frame, infinite where the matches do not determine the frame, and everywhere if the normal matrix is singular;
    `lens_information` (c, 5, 5), inverse covariance of each camera's lens terms, None in that case or if they were fixed."""

    deviations_px: Vector
    lens_information: Matrices | None = None


def island_certainty(
    problem: Problem, solution: Solution, cameras: Sequence[Camera], root: int, loss_px: float, run: Run = map
) -> IslandCertainty:
    """All n frames of the problem were free; `cameras` (c,) give the frames' sizes, `root` is the gauge frame. `run` as in
    `normal_equations.solve`."""
    layout, terms = solution.normal.layout, LENS_TERMS if problem.lens_free else 0
    factor = variance_factor(solution.residuals_px, loss_px, layout.unknowns - GAUGE)
    shifts = corner_shifts(problem, solution, cameras)[..., : POSE + terms]
    dependence = _dependence_of_root(shifts[root])
    if not math.isfinite(factor) or dependence is None:
        return IslandCertainty(np.full(len(problem.poses), np.inf))
    lenses = layout.lenses[problem.camera]
    partners, known = np.full(layout.vertices, -1), np.zeros((layout.vertices, BLOCK), bool)
    partners[layout.frames] = lenses
    known[layout.frames[root], :GAUGE] = True
    found = covariances(_in_gauge(solution.normal, layout.frames[root], lenses[root], dependence), partners, known, run)
    if found is None:
        return IslandCertainty(np.full(len(problem.poses), np.inf))
    of_pose_and_lens = _joint(found, layout.frames, lenses, terms)
    of_pose_and_lens[root] = dependence @ of_pose_and_lens[root] @ dependence.T
    deviations_px = math.sqrt(factor) * worst_corner(shifts, of_pose_and_lens) * problem.half_diagonal[problem.camera]
    of_lenses = solution.lens_covariances
    return IslandCertainty(deviations_px, None if of_lenses is None else np.asarray(np.linalg.inv(of_lenses)))


def resected_deviation(problem: Problem, solution: Solution, cameras: Sequence[Camera], factor: float) -> float:
    """As above for one free frame, the problem's first, against its fixed neighbours, lens fixed.

    `factor` is `variance_factor`, or a more cautious substitute.
    """
    if not math.isfinite(factor):
        return math.inf
    shifts = corner_shifts(problem, solution, cameras)[:1, ..., :POSE]
    covariance = factor * np.asarray(np.linalg.pinv(solution.normal.dense()), dtype=np.float64)
    return float(worst_corner(shifts, covariance[None])[0] * problem.half_diagonal[problem.camera[0]])


def variance_factor(residuals_px: PairValues, loss_px: float, unknowns: int) -> float:
    """Factor that turns the inverse normal matrix into a covariance.

    The normal matrix assumes residuals with a standard deviation of one feature pixel. This estimates the actual one under the
    Cauchy loss: Huber, Robust Statistics, 1981, section 7.6, for residuals of any direction. Infinite with too few matches (not
    NaN) for so many unknowns, or more wrong than right ones.
    """
    size2 = (residuals_px[np.isfinite(residuals_px)] / loss_px) ** 2
    measured = 2 * len(size2)
    weight = 1 / (1 + size2)
    pull2 = loss_px**2 * size2 * weight**2 / 2
    stiffness = weight - size2 * weight**2
    if measured <= unknowns or stiffness.mean() <= 0:
        return math.inf
    consistent = measured / (measured - unknowns)
    return float(WAYS * consistent * pull2.mean() * weight.mean() / stiffness.mean() ** 2)


def corner_shifts(problem: Problem, solution: Solution, cameras: Sequence[Camera]) -> Array:
    """Shift of each frame's corners by its pose and lens, in its own image: (n, 4, 2, 6 + lens terms).

    In half-diagonals; NaN for corners that see no ground.
    """
    sizes = np.array([[camera.width, camera.height] for camera in cameras])[problem.camera]
    solved = replace(problem, lenses=solution.lenses)
    half_diagonals, lenses = problem.half_diagonal[problem.camera], solved.lens_rows(problem.camera)
    half_sizes = sizes / half_diagonals[:, None] / 2
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half_sizes[:, None]
    down = projection.canvas_from_pixels(
        solution.poses.repeat(4, axis=0), lenses.repeat(4, axis=0), half_diagonals.repeat(4), corners.reshape(-1, 2)
    )
    by_all = np.concatenate([down.by_pose, down.by_lens], axis=2)
    shifts = np.full(by_all.shape, np.nan)
    shifts[down.valid] = np.linalg.solve(down.by_point[down.valid], by_all[down.valid])
    return shifts.reshape(len(sizes), 4, 2, -1)


def worst_corner(shifts: Array, covariance: Matrices) -> Vector:
    """Standard deviation (n,) of each frame's least certain corner; infinite where no corner sees ground.

    `shifts` (n, 4, 2, u) by u unknowns with `covariance` (n, u, u).
    """
    variances = np.einsum("ncij,njk,ncik->nc", shifts, covariance, shifts)
    worst = np.where(np.isnan(variances), -np.inf, variances).max(axis=1)
    return np.sqrt(np.where(np.isneginf(worst), np.inf, np.maximum(worst, 0)))


def _dependence_of_root(shifts: Array) -> SquareMatrix | None:
    """The root's pose and lens (u, u) with position, scale and heading as functions of the other unknowns.

    They are chosen so that the shifts of the root's corners (4, 2, u) contain no similarity. Simply fixing them would fix the
    nadir point, and an undetermined tilt would then move the image and all other frames. None if the root shows too little
    ground.
    """
    seen = np.isfinite(shifts).all(axis=(1, 2))
    if seen.sum() < 2:
        return None
    rows = shifts[seen].reshape(-1, shifts.shape[-1])
    dependence = np.eye(rows.shape[1])
    dependence[:GAUGE] = -np.linalg.lstsq(rows[:, :GAUGE], rows, rcond=None)[0]
    dependence[:GAUGE, :GAUGE] = 0
    return dependence


def _in_gauge(normal: Normal, root: int, lens: int, dependence: SquareMatrix) -> Normal:
    """The normal matrix of unknowns of which those of the root and its lens, two vertices (lens -1: it is fixed), were replaced.

    With D the identity but for `dependence`, D^T N D: only what these vertices have in common with others changes.
    """
    replaced = np.array([root, lens][: 1 if lens < 0 else 2])
    whole = np.eye(BLOCK * len(replaced))
    whole[: len(dependence), : len(dependence)] = dependence
    columns = normal.columns(replaced) @ whole
    own = whole.T @ columns[replaced].reshape(len(whole), -1)
    columns[replaced] = own.reshape(len(replaced), BLOCK, -1)
    return normal.with_columns(replaced, columns)


def _joint(found: Covariances, frames: Indices, lenses: Indices, terms: int) -> Matrices:
    """Covariances (n, u, u) of each frame's pose and lens, of these vertices (n,) each; a lens has so many free terms."""
    joint = np.empty((len(frames), POSE + terms, POSE + terms))
    joint[:, :POSE, :POSE] = found.own[frames]
    joint[:, :POSE, POSE:] = found.with_partner[frames, :, :terms]
    joint[:, POSE:, :POSE] = joint[:, :POSE, POSE:].transpose(0, 2, 1)
    joint[:, POSE:, POSE:] = found.own[lenses, :terms, :terms]
    return joint
