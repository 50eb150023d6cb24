"""Residuals of the matches and their derivatives by poses and lenses.

The ground is not a plane. A point of unknown height is seen shifted along its parallax, so a residual counts in full across
that direction and, along it, only beyond what the expected heights explain. Across it acts the epipolar geometry, which relief
cannot bend; along it the plane, which holds the overall shape of the map.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from gcs_mosaic.stitch.arrays import (
    Array,
    Indices,
    LensRowsNx6,
    Mask,
    Matrices,
    Matrix,
    PairPoints,
    PairValues,
    PointsNx2,
    PosesNx6,
    Vector,
)
from gcs_mosaic.stitch.bundle.problem import COLUMNS, Problem
from gcs_mosaic.stitch.camera import projection
from gcs_mosaic.stitch.camera.projection import LENS_TERMS, product


def parts(problem: Problem) -> Iterator[Problem]:
    """The problem in batches of pairs: derivatives of all pairs would fill memory, those of a batch fit the cache."""
    for start in range(0, max(len(problem.pairs), 1), PAIRS_AT_ONCE):
        some = slice(start, start + PAIRS_AT_ONCE)
        yield replace(
            problem,
            pairs=problem.pairs[some],
            pixels_a=problem.pixels_a[some],
            pixels_b=problem.pixels_b[some],
            present=problem.present[some],
        )


PAIRS_AT_ONCE = 128  # twice and half as many take as long


@dataclass(frozen=True, slots=True)
class Weighed:
    """Contribution of p pairs: their cost, one block of normal matrix and gradient each, and their residuals."""

    cost: float
    blocks: Matrices  # (p, COLUMNS, COLUMNS)
    slopes: Matrix  # (p, COLUMNS)
    residuals_px: PairValues  # (p, k)


def weighed(problem: Problem, discounts: Array, loss_px: float) -> Weighed:
    """Cost and derivatives of all matches, whitened by `discounts` (2, m, 2), under a Cauchy loss of scale `loss_px`."""
    residual, jacobian, valid = _residuals(problem, discounts)
    size2 = (residual**2).sum(axis=2) / loss_px**2
    weight = np.where(valid, 1 / (1 + size2), 0.0)
    # A match that is no longer visible (beyond the horizon) costs as much as a very bad one and has no gradient.
    cost = loss_px**2 * np.log1p(np.where(valid, size2, 1e4))[problem.present.repeat(2, axis=1)].sum()
    root = np.sqrt(weight)[:, :, None]
    rows = (residual * root).reshape(len(residual), -1)
    columns = (jacobian * root[..., None]).reshape(len(residual), -1, COLUMNS)
    blocks = columns.transpose(0, 2, 1) @ columns
    slopes = (columns.transpose(0, 2, 1) @ rows[:, :, None])[:, :, 0]
    ways = np.sqrt((residual**2).sum(axis=2)).reshape(len(residual), -1, 2).max(axis=2)
    size = np.where(problem.present, np.where(valid.reshape(*ways.shape, 2).all(axis=2), ways, np.inf), np.nan)
    return Weighed(float(cost), blocks, slopes, size)


def slopes_by_unmodelled(problem: Problem, discounts: Array, loss_px: float) -> Array:
    """What lens effects that the model leaves out add to the slopes of p pairs' cost, (p, COLUMNS, UNMODELLED).

    One standard deviation of each, in all frames: two tangential terms (Brown 1971), another scale along x than along y, and a
    shear; a rolling shutter over which the camera moves along or across its lines makes the last two.
    """
    residual, jacobian, valid = _residuals(problem, discounts)
    weight = np.where(valid, 1 / (1 + (residual**2).sum(axis=2) / loss_px**2), 0.0)
    p, k = problem.present.shape
    effects, sides = np.empty((p, k, 2, 2, len(UNMODELLED))), (problem.pixels_a, problem.pixels_b)
    for way, (source, target) in enumerate(((0, 1), (1, 0))):
        passage = _passage(problem, source, target)
        seen, there = (_unmodelled(sides[side]) for side in (source, target))
        unit = problem.unit_px[problem.camera[problem.pairs[:, target].repeat(k)]][:, None, None]
        by_effect = there * unit - product(passage.by_place, product(passage.down_by_pixel, seen))
        effects[:, :, way] = whitened(discounts[way], by_effect).reshape(p, k, 2, -1)
    weighted = effects.reshape(p, 2 * k, 2, -1) * weight[:, :, None, None]
    weighted[~valid] = 0  # NaN or infinity where nothing is visible
    rows, columns = (values.reshape(p, 4 * k, -1) for values in (weighted, jacobian))
    return np.asarray(columns.transpose(0, 2, 1) @ rows)


def _unmodelled(pixels: PairPoints) -> Matrices:
    """Shifts (p * k, 2, UNMODELLED) of pixels (p, k, 2), half-diagonals."""
    x, y = pixels.reshape(-1, 2).T
    r2 = x**2 + y**2
    shifts = np.array([[2 * x * y, r2 + 2 * x**2, x / 2, y / 2], [r2 + 2 * y**2, 2 * x * y, -y / 2, x / 2]])
    return np.asarray((shifts * UNMODELLED[:, None]).transpose(2, 0, 1))


# Standard deviations: tangential terms of a lens that was mounted a little off its axis, at the corner, half-diagonals; and what
# a rolling shutter of 30 ms makes of 7 m/s over a footprint of 100 m.
UNMODELLED = np.array([5e-4, 5e-4, 2e-3, 2e-3])


def discounts_of(problem: Problem) -> Array:
    """What whitens all match residuals in either direction, (2, m, 2), from the parallax at the present poses.

    Fixed for the whole adjustment. If they followed the poses, poses allowing more parallax would lower the cost, and the
    steps, which ignore that dependence, would stall.
    """
    return np.stack([discount(_passage(problem, *way).by_height * problem.relief) for way in ((0, 1), (1, 0))])


def _residuals(problem: Problem, discounts: Array) -> tuple[Array, Array, Mask]:
    """Residuals (p, 2k, 2), their derivatives (p, 2k, 2, COLUMNS), and which exist (p, 2k).

    The two directions of a match are adjacent: a to b, then b to a.
    """
    p, k = problem.present.shape
    residual, jacobian = np.empty((p, k, 2, 2)), np.zeros((p, k, 2, 2, COLUMNS))
    valid = np.empty((p, k, 2), bool)
    for way, (source, target) in enumerate(((0, 1), (1, 0))):
        passage = _passage(problem, source, target)
        residual[:, :, way] = whitened(discounts[way], passage.residual[:, :, None]).reshape(p, k, 2)
        valid[:, :, way] = passage.valid.reshape(p, k) & problem.present
        for columns, derivative in passage.derivatives:
            jacobian[:, :, way, :, columns] = whitened(discounts[way], derivative).reshape(p, k, 2, -1)
    residual[~valid], jacobian[~valid] = 0, 0  # NaN or infinity where nothing is visible
    return residual.reshape(p, 2 * k, 2), jacobian.reshape(p, 2 * k, 2, COLUMNS), valid.reshape(p, 2 * k)


@dataclass(frozen=True, slots=True)
class _Passage:
    """All matches projected from one side of their pairs to the plane and into the other side, (m, ...) in feature pixels."""

    residual: PointsNx2  # (m, 2)
    by_height: PointsNx2  # (m, 2), by height of the ground above the plane, per canvas unit
    by_place: Matrices  # (m, 2, 2), by place on the plane,
    down_by_pixel: Matrices  # (m, 2, 2), and of that place by the pixel of the first side
    derivatives: list[tuple[slice, Matrices]]  # (m, 2, ...) by pose and lens of either side, with their columns
    valid: Mask


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
        by_height=product(by_place, down.by_height[:, :, None])[:, :, 0] + up.by_height * unit,
        by_place=by_place,
        down_by_pixel=down.by_point,
        derivatives=[
            (poses[source], product(by_place, down.by_pose)),
            (lenses[source], product(by_place, down.by_lens)),
            (poses[target], up.by_pose * unit[:, :, None]),
            (lenses[target], up.by_lens * unit[:, :, None]),
        ],
        valid=down.valid & up.valid,
    )


def _of(problem: Problem, frames: Indices) -> tuple[PosesNx6, LensRowsNx6, Vector]:
    camera = problem.camera[frames]
    return problem.poses[frames], problem.lens_rows(camera), problem.half_diagonal[camera]


def discount(parallax: PointsNx2) -> PointsNx2:
    """Vectors q (m, 2) that whiten residuals with covariance I + parallax parallax^T, by I - q q^T.

    A point that may lie above or below the plane is only known to fall on a line: along it, one standard deviation of height
    shifts it by the parallax (m, 2) px, on top of one pixel of matching noise.
    """
    known = np.nan_to_num(parallax)
    squared = (known**2).sum(axis=1)
    along = (1 - 1 / np.sqrt(1 + squared)) / np.maximum(squared, 1e-12)
    return np.asarray(np.sqrt(along)[:, None] * known)


def whitened(discounts: PointsNx2, values: Matrices) -> Matrices:
    """Residuals or their derivatives (m, 2, k), whitened; as `discount` gives them."""
    along = discounts[:, 0, None] * values[:, 0] + discounts[:, 1, None] * values[:, 1]
    return values - discounts[:, :, None] * along[:, None]
