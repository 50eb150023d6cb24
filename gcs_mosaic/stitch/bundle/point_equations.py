"""Normal equations of an adjustment over points: reduced to poses and lenses, in the layout of `normal_equations`.

A point has a place and a height. Those of one point depend on no other point, so they are eliminated one by one (the Schur
complement: Triggs et al., "Bundle Adjustment - A Modern Synthesis", 2000, section 6.1): what is left has a block for two frames
that see a point in common.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from gcs_mosaic.stitch.arrays import AnyArray, Array, Indices, Matrices, Matrix, PointsNx2, RowsNx3, Vector
from gcs_mosaic.stitch.bundle.elimination import BLOCK
from gcs_mosaic.stitch.bundle.levenberg_marquardt import AdjustmentSettings, add_priors
from gcs_mosaic.stitch.bundle.normal_equations import EquationLayout, Normal, Run, blank, layout_of
from gcs_mosaic.stitch.bundle.problem import Problem
from gcs_mosaic.stitch.bundle.sighted_points import SightedPoints, together
from gcs_mosaic.stitch.camera import projection
from gcs_mosaic.stitch.camera.projection import LENS_TERMS

SLOTS_AT_ONCE = 8192  # their products of all pairs that share a point are held at a time: some 30 MB
INVISIBLE2 = 1e4  # squared residual of a sighting beyond the horizon, as in `residuals`, loss scales
LEAST_KNOWN = 1e-9  # added to a point's equations, relative to their trace: two rays along each other leave it open


@dataclass(frozen=True, slots=True)
class Sums:
    """Adds values (k, ...) to places (s, ...): `order` (k,) brings those of one place together, None if they are; they begin at
    `first` (p,) and belong to `places` (p,)."""

    order: Indices | None
    first: Indices
    places: Indices

    @classmethod
    def at(cls, places: Indices) -> Sums:
        """Of values that belong to these places (k,)."""
        order = np.argsort(places, kind="stable")
        return replace(cls.at_sorted(places[order]), order=order)

    @classmethod
    def at_sorted(cls, places: Indices) -> Sums:
        """Of values that belong to these places (k,), which ascend."""
        first = np.flatnonzero(np.concatenate([[True], np.diff(places) != 0])[: len(places)])
        return cls(None, first, places[first])

    def add(self, sums: Array, values: Array) -> None:
        if len(self.first):
            together = values if self.order is None else values[self.order]
            sums[self.places] += np.add.reduceat(together, self.first, axis=0)


@dataclass(frozen=True, slots=True)
class SlotPairs:
    """Slots of whole points, `some`, and all pairs of them that share a point, in the order in which `blocks` adds them."""

    some: slice
    one: AnyArray  # (k,) within these slots
    other: AnyArray  # (k,)
    blocks: Sums  # to a `Normal`
    slopes: Sums  # of slots, to a gradient


@dataclass(frozen=True, slots=True)
class PointLayout:
    """Which unknowns each point depends on: q slots, one for each frame that sees it and for each of their lenses."""

    equations: EquationLayout
    vertex: Indices  # (q,) of the frame or lens
    point: Indices  # (q,) ascending
    slots: tuple[Sums, Sums]  # of the sightings' frames and lenses: to slots,
    vertices: tuple[Sums, Sums]  # and to vertices
    edges: Sums  # of sightings, to the block between their frame and its lens
    pairs: tuple[SlotPairs, ...]


def point_layout(problem: Problem, seen: SightedPoints) -> PointLayout:
    """Layout of a problem whose frames and lenses are all free; `seen` has every pair of frames that has a point in common."""
    assert problem.free.all(), "islands are adjusted as a whole"
    assert problem.lens_free, "and with their lenses"
    linked = np.unique(np.concatenate([np.sort(problem.pairs, axis=1), seen.pairs()]), axis=0)
    equations = layout_of(replace(problem, pairs=linked))
    frames, lenses = equations.frames[seen.row], equations.lenses[problem.camera[seen.row]]
    keys = np.tile(seen.point, 2) * equations.vertices + np.concatenate([frames, lenses])
    kept, of_each = np.unique(keys, return_inverse=True)
    point, vertex = np.divmod(kept, equations.vertices)
    of_frames, of_lenses = of_each.reshape(2, -1)
    return PointLayout(
        equations,
        vertex,
        point,
        (Sums.at(of_frames), Sums.at(of_lenses)),
        (Sums.at(frames), Sums.at(lenses)),
        Sums.at(equations.edges_between(frames, lenses)),
        tuple(_pairs_of_slots(equations, vertex, point)),
    )


def _pairs_of_slots(equations: EquationLayout, vertex: Indices, point: Indices) -> Iterator[SlotPairs]:
    """All pairs of slots of a point, those of some thousand slots at a time."""
    start = 0
    while start < len(point):
        last = min(start + SLOTS_AT_ONCE, len(point)) - 1
        some = slice(start, int(np.searchsorted(point, point[last], side="right")))
        one, other = together(point[some])
        first, second = vertex[some][one], vertex[some][other]
        upper = first <= second
        one, other, first, second = one[upper], other[upper], first[upper], second[upper]
        places = first.copy()
        places[one != other] = equations.edges_between(first[one != other], second[one != other])
        order = np.argsort(places, kind="stable")
        # Narrow numbers: there are millions of them on a long flight.
        sides = one[order].astype(np.int32), other[order].astype(np.int32)
        yield SlotPairs(some, *sides, Sums.at_sorted(places[order]), Sums.at(vertex[some]))
        start = some.stop


@dataclass(frozen=True, slots=True)
class HeightPrior:
    """Heights of points about the plane: `sigma`, their standard deviation in flying heights, and `weights` (t,), how much of a
    height of its own each point is."""

    sigma: float
    weights: Vector


@dataclass(frozen=True, slots=True)
class PointState:
    """Poses and lenses of a problem, points (t, 3) of places and heights, and the reduced equations there."""

    problem: Problem
    points: RowsNx3
    prior: HeightPrior
    cost: float
    normal: Normal
    gradient: Matrix  # (v, BLOCK)
    _inverse: Matrices  # (t, 3, 3) of each point's own equations,
    _slope: RowsNx3  # (t, 3) the cost's slope by it,
    _shared: Matrices  # (q, BLOCK, 3) and what it has in common with each of its slots
    stopped: bool = False  # whether the last step, or those tried since, left the limits of a lens

    def points_after(self, layout: PointLayout, step: Matrix) -> RowsNx3:
        """Where the points (t, 3) go if poses and lenses go this step (v, BLOCK)."""
        by_slot = np.einsum("qbk,qb->qk", self._shared, step[layout.vertex])
        first = np.searchsorted(layout.point, np.arange(len(self.points)))
        slope = self._slope + np.add.reduceat(by_slot, first, axis=0)
        return np.asarray(self.points - np.einsum("tij,tj->ti", self._inverse, slope))


def flying_height(problem: Problem) -> float:
    """Geometric mean of the frames' heights above the plane, canvas units."""
    camera = problem.camera
    return float(
        np.exp((problem.poses[:, 2] + problem.lenses[camera, 0] + np.log(problem.half_diagonal[camera])).mean())
    )


@dataclass(frozen=True, slots=True)
class _Sighted:
    """m sightings, whitened by the loss: residuals and their derivatives by pose, lens and point."""

    residual: PointsNx2
    by_pose: Matrices  # (m, 2, 6)
    by_lens: Matrices  # (m, 2, 5)
    by_point: Matrices  # (m, 2, 3)
    size2: Vector  # squared residuals, loss scales


def _sighted(problem: Problem, seen: SightedPoints, points: RowsNx3, loss_px: float) -> _Sighted:
    camera, at = problem.camera[seen.row], points[seen.point]
    poses, lenses, half_diagonals = problem.poses[seen.row], problem.lens_rows(camera), problem.half_diagonal[camera]
    up = projection.pixels_from_canvas(poses, lenses, half_diagonals, at[:, :2], at[:, 2])
    off = (up.points - seen.pixels) * (problem.unit_px[camera] / loss_px)[:, None]
    size2 = np.where(up.valid, (off**2).sum(axis=1), INVISIBLE2)
    # A Cauchy loss. What is not visible costs, and has no slope.
    scale = np.where(up.valid, problem.unit_px[camera] / np.sqrt(1 + size2), 0.0)
    by_point = np.concatenate([up.by_point, up.by_height[:, :, None]], axis=2)
    by_pose, by_lens, by_point = (_scaled(by, scale) for by in (up.by_pose, up.by_lens, by_point))
    return _Sighted(_scaled(up.points - seen.pixels, scale), by_pose, by_lens, by_point, size2)


def _scaled(values: Array, scale: Vector) -> Array:
    """Values (m, ...) times (m,); zero where that is zero, whatever they are."""
    scale = scale.reshape(-1, *[1] * (values.ndim - 1))
    return np.where(scale > 0, values * scale, 0.0)


def _own_equations(
    sighted: _Sighted, seen: SightedPoints, points: RowsNx3, prior: HeightPrior, height: float
) -> tuple[Matrices, RowsNx3]:
    """Inverse equations (t, 3, 3) of each point alone, and the slope of the cost by it, (t, 3)."""
    across = sighted.by_point.transpose(0, 2, 1)
    own, slope = seen.sums(across @ sighted.by_point), seen.sums((across @ sighted.residual[:, :, None])[:, :, 0])
    firm = prior.weights / (prior.sigma * height) ** 2
    own[:, 2, 2] += firm
    slope[:, 2] += firm * points[:, 2]
    own += (LEAST_KNOWN * np.trace(own, axis1=1, axis2=2) + 1e-12)[:, None, None] * np.eye(3)
    return np.asarray(np.linalg.inv(own)), slope


@dataclass(frozen=True, slots=True)
class PointEquations:
    """Makes the reduced equations of one adjustment; `run` as in `normal_equations.solve`."""

    layout: PointLayout
    seen: SightedPoints
    settings: AdjustmentSettings
    run: Run

    def at(self, problem: Problem, points: RowsNx3, prior: HeightPrior) -> PointState:
        """The equations at these poses, lenses and points (t, 3)."""
        normal, gradient = blank(self.layout.equations)
        cost = add_priors(problem, self.settings, normal, gradient)
        sighted, height = _sighted(problem, self.seen, points, self.settings.loss_px), flying_height(problem)
        inverse, slope = _own_equations(sighted, self.seen, points, prior, height)
        of_heights = float((prior.weights * (points[:, 2] / (prior.sigma * height)) ** 2).sum())
        cost += float(self.settings.loss_px**2 * np.log1p(sighted.size2).sum()) + of_heights
        _pull_of_heights(problem, self.layout.equations, gradient, of_heights)
        shared = _add_sightings(normal, gradient, self.layout, sighted)
        _eliminate(normal, gradient, self.layout, shared, inverse, slope)
        return PointState(problem, points, prior, cost, normal, gradient, inverse, slope, shared)

    def residuals_px(self, state: PointState) -> Vector:
        """How far each sighting (m,) is from where its point is seen; some hundred pixels for what is out of sight."""
        sighted = _sighted(state.problem, self.seen, state.points, self.settings.loss_px)
        return np.asarray(np.sqrt(sighted.size2) * self.settings.loss_px)

    def settled(self, problem: Problem, points: RowsNx3, prior: HeightPrior, rounds: int) -> RowsNx3:
        """The points (t, 3) after some steps of their own towards where these poses and lenses see them."""
        height = flying_height(problem)
        for _ in range(rounds):
            sighted = _sighted(problem, self.seen, points, self.settings.loss_px)
            inverse, slope = _own_equations(sighted, self.seen, points, prior, height)
            points = points - (inverse @ slope[:, :, None])[:, :, 0]
        return points


def _pull_of_heights(problem: Problem, layout: EquationLayout, gradient: Matrix, of_heights: float) -> None:
    """The slope of the heights' cost by the flying height that they are measured in.

    Without it the prior, in canvas units, would shrink the map: no match determines its scale.
    """
    n = len(problem.poses)
    gradient[layout.frames, 2] -= of_heights / n
    gradient[layout.lenses, 0] -= of_heights * np.bincount(problem.camera, minlength=len(problem.lenses)) / n


def _add_sightings(normal: Normal, gradient: Matrix, layout: PointLayout, sighted: _Sighted) -> Matrices:
    """Add what the sightings say of poses and lenses; returns what they have in common with points, (q, BLOCK, 3) by slot."""
    by_lens = np.pad(sighted.by_lens, ((0, 0), (0, 0), (0, BLOCK - LENS_TERMS)))
    shared = np.zeros((len(layout.vertex), BLOCK, 3))
    for slots, vertices, by in zip(layout.slots, layout.vertices, (sighted.by_pose, by_lens), strict=True):
        across = by.transpose(0, 2, 1)
        slots.add(shared, across @ sighted.by_point)
        vertices.add(normal.blocks, across @ by)
        vertices.add(gradient, (across @ sighted.residual[:, :, None])[:, :, 0])
    layout.edges.add(normal.blocks, sighted.by_pose.transpose(0, 2, 1) @ by_lens)
    return shared


def _eliminate(
    normal: Normal, gradient: Matrix, layout: PointLayout, shared: Matrices, inverse: Matrices, slope: RowsNx3
) -> None:
    """Subtract what the points take along when poses and lenses move."""
    for pairs in layout.pairs:
        point, own = layout.point[pairs.some], shared[pairs.some]
        along = own @ inverse[point]
        pairs.slopes.add(gradient, -(along @ slope[point][:, :, None])[:, :, 0])
        pairs.blocks.add(normal.blocks, along[pairs.one] @ -own.transpose(0, 2, 1)[pairs.other])
