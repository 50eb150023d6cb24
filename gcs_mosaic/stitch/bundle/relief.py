"""Relief displacement of each frame, from links and poses.

Matched features become tracks, tracks become ground points, and a smooth grid of shifts absorbs the residuals between a frame's
pose and where it sees those points. The poses stay fixed, and with them the shape of the map: the grid is an elastic sheet (a
membrane that resists stretching, weakly tied to zero), so where a frame has no tracks it remains a camera over a plane.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solveh_banded

from gcs_mosaic.stitch.arrays import (
    Counts,
    FeaturePairsNx2,
    IndexPairsNx2,
    IndexRows,
    Indices,
    Matrix,
    Points32Nx2,
    PointsNx2,
    ShiftGrid,
    Vector,
)
from gcs_mosaic.stitch.bundle.relief_points import tracks, triangulate
from gcs_mosaic.stitch.camera import projection
from gcs_mosaic.stitch.camera.geometry import Camera, Pose, pixels_from_canvas
from gcs_mosaic.stitch.camera.projection import lens_row, pose_row
from gcs_mosaic.stitch.camera.relief import ReliefDisplacement, ReliefSettings
from gcs_mosaic.stitch.graph.view_graph import ViewGraph

ROUNDS = 4  # of reweighting
SIGHTINGS_AT_ONCE = 4096  # projected at a time: what fits into the cache
FEWEST = 10  # points of a frame below which no grid is fitted


@dataclass(frozen=True, slots=True)
class MatchedPoints:
    """All matches of p linked pairs among n frames, k in all, as stored; quick to gather. See `sightings`."""

    pairs: IndexPairsNx2  # (p, 2) rows of the frames, 0 to n - 1
    counts: Counts  # (p,) number of matches of each pair
    features: FeaturePairsNx2  # (k, 2) feature index in either frame
    points: Points32Nx2  # (f, 2) pixels of the features of all frames, frame by frame
    lengths: Counts  # (n,) number of features of each frame
    scales: Vector  # (n,) full-resolution pixels per pixel of the frame's feature picture


@dataclass(frozen=True, slots=True)
class Sightings:
    """Observations of ground points by n frames, m in all."""

    row: Indices  # (m,) the frame, 0 to n - 1
    pixels: PointsNx2  # (m, 2)
    point: Indices  # (m,)
    scales: Vector  # (n,) as in `Matched`


def matched(graph: ViewGraph, frames: Sequence[int], of: Sequence[int] | None = None) -> MatchedPoints | None:
    """The matches of all links between these frames, or only of the links `of` some of them; None without links."""
    row = {frame: number for number, frame in enumerate(frames)}
    ends = {(f, o) for f in (of or frames) for o in graph.frames[f].inliers if o in row}
    keys = sorted({(a, b) if (a, b) in graph.links else (b, a) for a, b in ends})
    if not keys:
        return None
    matches = [graph.links[key].features for key in keys]
    features = [graph.frames[frame].features for frame in frames]
    return MatchedPoints(
        pairs=np.array([(row[a], row[b]) for a, b in keys], dtype=np.intp),
        counts=np.array([len(some) for some in matches], dtype=np.intp),
        features=np.concatenate(matches),
        points=np.concatenate([one.points for one in features]),
        lengths=np.array([len(one) for one in features], dtype=np.intp),
        scales=np.array([one.scale for one in features]),
    )


def sightings(matches: MatchedPoints) -> Sightings:
    """Observations from matches: a feature matched in several pairs is one ground point."""
    first = np.concatenate([[0], np.cumsum(matches.lengths)[:-1]])
    ends = first[matches.pairs].repeat(matches.counts, axis=0) + matches.features
    seen, nodes = np.unique(ends, return_inverse=True)
    row = np.searchsorted(first, seen, side="right") - 1
    found = tracks(nodes.reshape(-1, 2), row)
    kept = seen[found.nodes]
    return Sightings(row[found.nodes], matches.points[kept].astype(np.float64), found.track, matches.scales)


def note_relief(graph: ViewGraph, frame: int, settings: ReliefSettings) -> None:
    """Compute the relief displacement of one placed frame from all frames it is linked with, at their poses."""
    frames = [frame, *graph.frames[frame].inliers]
    matches = matched(graph, frames, of=[frame])
    views = [(graph.pose_of(f), graph.camera_of(f)) for f in frames]
    graph.note(frame, relief=displacements(sightings(matches), views, settings, of=[0])[0] if matches else None)


def displacements(
    seen: Sightings,
    views: Sequence[tuple[Pose, Camera]],
    settings: ReliefSettings,
    of: Sequence[int] | None = None,
    drawn: Sequence[tuple[Pose, Camera]] | None = None,
) -> list[ReliefDisplacement | None]:
    """Relief displacements of frames at these poses, for all rows or only rows `of`; `drawn`: of poses that they are drawn at
    instead of those that they see the ground from."""
    rows = range(len(views)) if of is None else of
    if settings.cells == 0:
        return [None] * len(rows)
    return [
        displacement(*view, ground, settings)
        for view, ground in zip(_chosen(drawn or views, rows), seen_ground(seen, views, settings, rows), strict=True)
    ]


@dataclass(frozen=True, slots=True)
class SeenGround:
    """Ground points (m, 2) on the canvas that a frame sees at pixels (m, 2); `scale` as in `MatchedPoints`."""

    scale: float
    pixels: PointsNx2
    points: PointsNx2


def seen_ground(
    seen: Sightings, views: Sequence[tuple[Pose, Camera]], settings: ReliefSettings, rows: Sequence[int]
) -> Iterator[SeenGround]:
    """What each of these frames sees of the ground, at these poses of all frames."""
    points = _points(seen, views, settings)
    order = np.argsort(seen.row, kind="stable")
    ends = np.searchsorted(seen.row[order], np.arange(len(views) + 1))
    for row in rows:
        own = order[ends[row] : ends[row + 1]]
        yield SeenGround(float(seen.scales[row]), seen.pixels[own], points[seen.point[own]])


def _chosen(views: Sequence[tuple[Pose, Camera]], rows: Sequence[int]) -> Iterator[tuple[Pose, Camera]]:
    return (views[row] for row in rows)


def _points(seen: Sightings, views: Sequence[tuple[Pose, Camera]], settings: ReliefSettings) -> PointsNx2:
    """Canvas places (t, 2) of the points; NaN for one seen above the horizon."""
    poses = np.array([pose_row(pose) for pose, _ in views])
    lenses = np.array([lens_row(camera) for _, camera in views])
    half = np.array([camera.half_diagonal for _, camera in views])
    centres = np.array([camera.centre for _, camera in views])
    row = seen.row
    pixels = (seen.pixels - centres[row]) / half[row, None]
    places, by_height = np.empty((2, len(row), 2))
    for start in range(0, len(row), SIGHTINGS_AT_ONCE):  # millions on a long flight, each with all its derivatives
        some = slice(start, start + SIGHTINGS_AT_ONCE)
        down = projection.canvas_from_pixels(poses[row[some]], lenses[row[some]], half[row[some]], pixels[some])
        places[some], by_height[some] = np.where(down.valid[:, None], down.points, np.nan), down.by_height
    deviations = np.exp(poses[:, 2]) * seen.scales * settings.loss_px
    height = float(np.median(np.exp(poses[:, 2] + lenses[:, 0]) * half))
    return triangulate(places, by_height, deviations[row], seen.point, settings.sigma * height)


def displacement(pose: Pose, camera: Camera, ground: SeenGround, settings: ReliefSettings) -> ReliefDisplacement | None:
    """A frame's grid from the ground that it sees; None if there are too few points."""
    scale, pixels = ground.scale, ground.pixels
    shifts = pixels_from_canvas(pose, camera, ground.points) - pixels
    with np.errstate(invalid="ignore"):
        believed = np.linalg.norm(shifts, axis=1) < settings.largest * camera.half_diagonal
    if believed.sum() < FEWEST:
        return None
    at = pixels[believed] / [camera.width - 1, camera.height - 1]
    sheet = fitted_sheet(at, shifts[believed] / scale, *grid_size(camera, settings.cells), settings)
    return ReliefDisplacement.from_grid(sheet * scale / camera.half_diagonal)


def grid_size(camera: Camera, cells: int) -> tuple[int, int]:
    """Columns and rows of a grid of nearly square cells, `cells` along the longer side."""
    longer = max(camera.width, camera.height)
    return (max(2, round(cells * camera.width / longer) + 1), max(2, round(cells * camera.height / longer) + 1))


def fitted_sheet(at: PointsNx2, values: PointsNx2, columns: int, rows: int, settings: ReliefSettings) -> ShiftGrid:
    """Elastic sheet (rows, columns, 2) robustly fitted to values (m, 2) at places (m, 2), 0 to 1 along each side."""
    node, share = _corners(at, columns, rows)
    fixed = _membrane(columns, rows, settings)
    sheet, weight = np.zeros((columns * rows, 2)), np.ones(len(at))
    for _ in range(ROUNDS):
        band = fixed.copy()
        for i in range(4):
            for j in range(i, 4):
                np.add.at(band, (node[:, j] - node[:, i], node[:, i]), weight * share[:, i] * share[:, j])
        right = np.stack(
            [
                np.bincount(node.ravel(), (share * (weight * values[:, k])[:, None]).ravel(), columns * rows)
                for k in (0, 1)
            ],
            axis=1,
        )
        sheet = solveh_banded(band, right, lower=True, check_finite=False)
        off2 = ((share[:, :, None] * sheet[node]).sum(axis=1) - values) ** 2
        weight = 1 / (1 + off2.sum(axis=1) / settings.loss_px**2)
    return np.asarray(sheet).reshape(rows, columns, 2)


def _corners(at: PointsNx2, columns: int, rows: int) -> tuple[IndexRows, Matrix]:
    """The four nodes (m, 4) around each place, ascending, and their bilinear weights (m, 4)."""
    cell = at * [columns - 1, rows - 1]
    first = np.clip(cell.astype(np.intp), 0, [columns - 2, rows - 2])
    x, y = (cell - first).T
    corner = first[:, 1] * columns + first[:, 0]
    nodes = corner[:, None] + np.array([0, 1, columns, columns + 1])
    return nodes, np.stack([(1 - x) * (1 - y), x * (1 - y), (1 - x) * y, x * y], axis=1)


def _membrane(columns: int, rows: int, settings: ReliefSettings) -> Matrix:
    """Normal matrix (columns + 2, n) of the sheet alone, as lower diagonals."""
    band = np.zeros((columns + 2, columns * rows))
    band[0] = settings.tie
    nodes = np.arange(columns * rows).reshape(rows, columns)
    for step, first in ((1, nodes[:, :-1].ravel()), (columns, nodes[:-1].ravel())):
        band[step, first] -= settings.stiffness
        band[0, first] += settings.stiffness
        band[0, first + step] += settings.stiffness
    return band
