"""Overlap check: do the frames around a pose confirm it?

One pair of frames can share a look-alike and little else: then its own matches cannot decide. The surrounding frames can: where
they see the same ground as this frame, at similar resolution, some match must confirm it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from gcs_mosaic.stitch.arrays import Counts, Mask, PointsNx2
from gcs_mosaic.stitch.camera.geometry import (
    Camera,
    Pose,
    canvas_from_pixels,
    ground_sampling_distance,
    pixel_grid,
    pixels_from_canvas,
)
from gcs_mosaic.stitch.graph.view_graph import ViewGraph
from gcs_mosaic.stitch.registration.a_contrario import Confirmed

COLUMNS, ROWS = 8, 6  # cells of a frame: each has dozens of features over textured ground
COMPARABLE = 3  # features below which a cell is ignored
SHARPER = 2.0  # ratio of resolutions; SIFT bridges more, but with fewer and fewer matches


def confirmed_around(
    graph: ViewGraph, frame: int, pose: Pose, island: int, others: Sequence[int], matched: Iterable[PointsNx2]
) -> Confirmed:
    """Share of the cells common to the frame at this pose and other frames of an island that matches confirm: of cells with
    features matched before if they suffice, else of all commonly seen cells.

    matched: the frame's full-resolution pixels (m, 2) that were matched with any of them.
    """
    camera = graph.camera_on(island, graph.frames[frame].camera)
    agreeing = _counts(np.concatenate([*matched, np.empty((0, 2))]), camera) > 0
    full = _full_cells(graph, frame, camera)
    expected = full & _matched_before_by_any(graph, frame, pose, camera, others)
    if expected.sum() < ENOUGH_CELLS:
        expected = full & _seen_by_any(graph, pose, camera, others)
    return Confirmed(float(agreeing[expected].mean()) if expected.any() else 1.0, int(expected.sum()))


ENOUGH_CELLS = 6


def _matched_before_by_any(graph: ViewGraph, frame: int, pose: Pose, camera: Camera, others: Sequence[int]) -> Mask:
    """Cells (ROWS * COLUMNS,) where others have features matched with frames other than this one, at similar resolution."""
    counts = np.zeros(ROWS * COLUMNS, np.intp)
    for other in others:
        view = graph.pose_of(other), graph.camera_of(other)
        pixels = graph.frames[other].features.points[graph.matched_before(other, but=frame)].astype(np.float64)
        places = pixels_from_canvas(pose, camera, canvas_from_pixels(*view, pixels))
        with np.errstate(invalid="ignore"):
            inside = ((places >= 0) & (places < [camera.width, camera.height])).all(axis=1)
        ratio = ground_sampling_distance(*view, pixels[inside]) / ground_sampling_distance(pose, camera, places[inside])
        alike = (ratio < SHARPER) & (ratio > 1 / SHARPER)
        counts = np.maximum(counts, _counts(places[inside][alike], camera))
    return np.asarray(counts >= COMPARABLE)


def _full_cells(graph: ViewGraph, frame: int, camera: Camera) -> Mask:
    points = graph.frames[frame].features.points.astype(np.float64)
    return np.asarray(_counts(points, camera) >= COMPARABLE)


def _counts(pixels: PointsNx2, camera: Camera) -> Counts:
    """Number of pixels (n, 2) in each cell, (ROWS * COLUMNS,)."""
    column, row = ((pixels + 0.5) * [COLUMNS / camera.width, ROWS / camera.height]).astype(int).T
    return np.bincount(row.clip(0, ROWS - 1) * COLUMNS + column.clip(0, COLUMNS - 1), minlength=ROWS * COLUMNS)


def _seen_by_any(graph: ViewGraph, pose: Pose, camera: Camera, others: Sequence[int]) -> Mask:
    """Cells (ROWS * COLUMNS,) whose centre another frame sees at similar resolution."""
    half_cell = np.array([camera.width / COLUMNS, camera.height / ROWS]) / 2
    inner = Camera(camera.width, camera.height)
    middles = half_cell - 0.5 + pixel_grid(inner, COLUMNS, ROWS) * (1 - np.array([1 / COLUMNS, 1 / ROWS]))
    places = canvas_from_pixels(pose, camera, middles)
    own = ground_sampling_distance(pose, camera, middles)
    seen = np.zeros(len(middles), bool)
    for other in others:
        view = graph.pose_of(other), graph.camera_of(other)
        pixels = pixels_from_canvas(*view, places)
        with np.errstate(invalid="ignore"):
            inside = ((pixels >= 0) & (pixels < [view[1].width, view[1].height])).all(axis=1)
            ratio = ground_sampling_distance(*view, pixels) / own
            seen |= inside & (ratio < SHARPER) & (ratio > 1 / SHARPER)
    return seen
