"""Relief displacement of each frame, from links and poses.

Matched features become tracks, and tracks points of the ground with heights. All points that a frame or those linked with it saw
tell the heights of the ground under it, an elastic sheet over its grid, and so where on the map each node's ground belongs. What
a frame still sees elsewhere than it should (its lens, a rolling shutter) a second, stiffer sheet takes up. The poses stay fixed,
and with them the shape of the map: where nobody saw a point the ground is as high as the middle of what the frame sees.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from gcs_mosaic.stitch.arrays import Indices, Mask, Matrix, PointsNx2, ShiftGrid, Vector
from gcs_mosaic.stitch.bundle.elastic_sheet import GRADUATED, Elasticity, fitted_sheet, grid_size, on_sheet
from gcs_mosaic.stitch.bundle.matched_points import Sightings, matched, sightings
from gcs_mosaic.stitch.bundle.relief_points import GroundPoints, ground_points
from gcs_mosaic.stitch.camera import projection
from gcs_mosaic.stitch.camera.geometry import Camera, View, pixel_grid, pixels_from_canvas
from gcs_mosaic.stitch.camera.projection import Projected, lens_row, pose_row
from gcs_mosaic.stitch.camera.relief import ReliefDisplacement, ReliefSettings
from gcs_mosaic.stitch.graph.view_graph import ViewGraph

SIGHTINGS_AT_ONCE = 4096  # projected at a time: what fits into the cache
FEWEST = 10  # points of a frame below which no grid is fitted
OUTERMOST = 0.9  # of a frame's nodes: what the others would shift by height, at the horizon, tells nothing of the frame


def note_relief(graph: ViewGraph, frame: int, settings: ReliefSettings) -> None:
    """Compute the relief displacement of one placed frame from all frames it is linked with, at their poses."""
    frames = [frame, *graph.frames[frame].inliers]
    matches = matched(graph, frames, of=[frame])
    views = [(graph.pose_of(f), graph.camera_of(f)) for f in frames]
    graph.note(frame, relief=displacements(sightings(matches), views, settings, of=[0])[0] if matches else None)


def displacements(
    seen: Sightings,
    views: Sequence[View],
    settings: ReliefSettings,
    of: Sequence[int] | None = None,
    drawn: Sequence[View] | None = None,
) -> list[ReliefDisplacement | None]:
    """Relief displacements of frames at these poses, for all rows or only rows `of`; `drawn`: of poses that they are drawn at
    instead of those that they see the ground from."""
    rows = range(len(views)) if of is None else of
    if settings.cells == 0:
        return [None] * len(rows)
    return [
        _displacement(frame, settings) for frame in _frames_over_ground(seen, views, drawn or views, settings, rows)
    ]


@dataclass(frozen=True, slots=True)
class FrameOverGround:
    """A frame, the points of the ground that it sees at pixels (m, 2), and those of the frames around it; `scale` as in
    `MatchedPoints`."""

    view: View
    drawn: View
    scale: float
    pixels: PointsNx2
    own: GroundPoints
    around: GroundPoints


def _frames_over_ground(
    seen: Sightings, views: Sequence[View], drawn: Sequence[View], settings: ReliefSettings, rows: Sequence[int]
) -> Iterator[FrameOverGround]:
    points = _points(seen, views, settings)
    order = np.argsort(seen.row, kind="stable")
    ends = np.searchsorted(seen.row[order], np.arange(len(views) + 1))
    around = PointsAround(seen, len(views))
    for row in rows:
        own = order[ends[row] : ends[row + 1]]
        yield FrameOverGround(
            *(views[row], drawn[row], float(seen.scales[row]), seen.pixels[own]),
            *(points.some(seen.point[own]), points.some(around(row))),
        )


def _points(seen: Sightings, views: Sequence[View], settings: ReliefSettings) -> GroundPoints:
    """The points (t); NaN for one seen above the horizon."""
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
    return ground_points(places, by_height, deviations[row], seen.point, settings.sigma * height)


class PointsAround:
    """Of each of n frames the points that it does not see but a frame does which sees one of its points too."""

    def __init__(self, seen: Sightings, n: int) -> None:
        points = int(seen.point.max(initial=-1)) + 1
        ones = np.ones(len(seen.row), bool)
        self._seen = sparse.csr_matrix((ones, (seen.row, seen.point)), shape=(n, points))
        self._sees_with = (self._seen @ self._seen.T).tocsr()
        self._last = np.full(points, -1)

    def __call__(self, row: int) -> Indices:
        others = self._sees_with.indices[slice(*self._sees_with.indptr[row : row + 2])]
        of_others = self._seen[others].indices
        self._last[of_others] = np.arange(len(of_others))  # of those that are told several times, the last one
        self._last[self._seen[[row]].indices] = -1
        return np.asarray(of_others[self._last[of_others] == np.arange(len(of_others))], np.intp)


def _displacement(frame: FrameOverGround, settings: ReliefSettings) -> ReliefDisplacement | None:
    """A frame's grid from the ground that it sees; None if there are too few points."""
    pose, camera = frame.drawn
    shifts = pixels_from_canvas(pose, camera, frame.own.places) - frame.pixels
    with np.errstate(invalid="ignore"):
        believed = np.linalg.norm(shifts, axis=1) < settings.largest * camera.half_diagonal
    if believed.sum() < FEWEST:
        return None
    columns, rows = grid_size(camera, settings.cells)
    at = _share_of_frame(camera, frame.pixels[believed])
    by_height = _shifts_by_height(frame, at, frame.own.some(believed), (columns, rows), settings)
    left = (shifts[believed] - on_sheet(by_height, at)) / frame.scale
    elasticity = Elasticity(settings.rest_stiffness, np.inf, settings.tie, settings.loss_px)
    rest = fitted_sheet(at, left, (columns, rows), elasticity)
    return ReliefDisplacement.from_grid((by_height + rest * frame.scale) / camera.half_diagonal)


def _shifts_by_height(
    frame: FrameOverGround, at: PointsNx2, own: GroundPoints, size: tuple[int, int], settings: ReliefSettings
) -> ShiftGrid:
    """Shifts (rows, columns, 2) in pixels from where the frame sees the ground at the nodes of its grid to where it would as it
    is drawn, if the ground were a plane; 0 above the horizon."""
    pose, camera = frame.view
    nodes = pixel_grid(camera, *size)
    down = _down(frame.view, nodes)
    if not down.valid.any():
        return np.zeros((size[1], size[0], 2))
    per_height = np.linalg.norm(down.by_height[down.valid], axis=1) / (np.exp(pose.log_gsd) * frame.scale)
    px = float(np.sqrt(np.mean(np.minimum(per_height, np.quantile(per_height, OUTERMOST)) ** 2)))
    heights = _heights(frame, at, own, size, px, settings)
    places = down.points + heights.reshape(-1, 1) * down.by_height
    shifts = pixels_from_canvas(*frame.drawn, places) - nodes
    known = down.valid & np.isfinite(shifts).all(axis=1)
    return np.where(known[:, None], shifts, 0.0).reshape(*heights.shape[:2], 2)


def _heights(
    frame: FrameOverGround, at: PointsNx2, own: GroundPoints, size: tuple[int, int], px: float, settings: ReliefSettings
) -> Matrix:
    """Heights (rows, columns) of the ground at the nodes of a frame's grid; px: pixels of its feature picture by which it sees
    ground shifted per unit of height."""
    inside, at_others = _inside(frame.view, frame.around)
    others = frame.around.some(inside)
    heights = np.concatenate([own.heights, others.heights])
    middle = float(np.median(own.heights))
    elasticity = Elasticity(settings.stiffness, settings.step_px, settings.tie, settings.loss_px, GRADUATED)
    weight = np.concatenate([_certainty(own, px), _certainty(others, px)])
    sheet = fitted_sheet(np.concatenate([at, at_others]), (heights[:, None] - middle) * px, size, elasticity, weight)
    return middle + sheet[:, :, 0] / px


def _certainty(points: GroundPoints, px: float) -> Vector:
    """How much points (m,) count, 0 to 1: by how well their height is known, and their rays meet."""
    return np.asarray(1 / (1 + px**2 * points.variances) / (1 + points.off2))


def _inside(view: View, points: GroundPoints) -> tuple[Mask, PointsNx2]:
    """Which of the points (m,) lie within the frame, and where those do, 0 to 1 along each side."""
    pose, camera = view
    above, below = np.exp(pose.log_gsd) * camera.focal_px, np.array([pose.x, pose.y])
    with np.errstate(divide="ignore", invalid="ignore"):
        shadows = below + (points.places - below) * (above / (above - points.heights))[:, None]
        at = _share_of_frame(camera, pixels_from_canvas(pose, camera, shadows))
        within = (at >= 0) & (at <= 1)
    inside = np.asarray(within[:, 0] & within[:, 1] & (points.heights < above))
    return inside, at[inside]


def _share_of_frame(camera: Camera, pixels: PointsNx2) -> PointsNx2:
    return np.asarray(pixels / [camera.width - 1, camera.height - 1])


def _down(view: View, pixels: PointsNx2) -> Projected:
    pose, camera = view
    n, half = len(pixels), camera.half_diagonal
    poses, lenses = np.tile(pose_row(pose), (n, 1)), np.tile(lens_row(camera), (n, 1))
    return projection.canvas_from_pixels(poses, lenses, np.full(n, half), (pixels - camera.centre) / half)
