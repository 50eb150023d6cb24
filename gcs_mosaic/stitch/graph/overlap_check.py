"""Overlap check: do the frames around a pose confirm it?

One pair of frames can share a look-alike and little else: then its own matches cannot decide. The surrounding frames can: where
they see the same ground as this frame, at similar resolution, some match must confirm it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from gcs_mosaic.stitch.arrays import Mask, PointsNx2, Vector
from gcs_mosaic.stitch.camera.geometry import (
    Camera,
    Pose,
    canvas_from_pixels,
    ground_sampling_distance,
    pixels_from_canvas,
)
from gcs_mosaic.stitch.features.frame_cells import CELLS, centres, counts
from gcs_mosaic.stitch.graph.silent_ground import COMPARABLE, full_cells, silent_cells
from gcs_mosaic.stitch.graph.view_graph import ViewGraph
from gcs_mosaic.stitch.registration.a_contrario import Confirmed, log_odds
from gcs_mosaic.stitch.registration.outcome import Registration

EVERYWHERE = np.True_
SHARPER = 2.0  # ratio of resolutions; SIFT bridges more, but with fewer and fewer matches


def odds_around(
    graph: ViewGraph, frame: int, pose: Pose, island: int, links: Mapping[int, Registration | None], least: float
) -> tuple[Confirmed, float]:
    """What of a frame at this pose is confirmed by others of an island, which it was compared with, and the log10 likelihood
    ratio of a true pose to a look-alike; where that is less than `least`, ground that is never found again is left out."""
    matched = [link.agreeing_a for link in links.values() if link is not None]
    found = confirmed_around(graph, frame, pose, island, list(links), matched)
    odds = log_odds(found, graph.true_share)
    if odds >= least:
        return found, odds
    silent = silent_cells(graph, graph.frames[frame].features, frame)
    if silent.any():
        telling = confirmed_around(graph, frame, pose, island, list(links), matched, ~silent)
        of_these = log_odds(telling, graph.true_share)
        if telling.cells >= ENOUGH_CELLS and of_these > odds:
            return telling, of_these
    return found, odds


def confirmed_around(
    graph: ViewGraph,
    frame: int,
    pose: Pose,
    island: int,
    others: Sequence[int],
    matched: Iterable[PointsNx2],
    asked: Mask | np.bool_ = EVERYWHERE,
) -> Confirmed:
    """Share of the cells common to the frame at this pose and other frames of an island that matches confirm: of cells with
    features matched before if they suffice, else of all commonly seen cells.

    matched: the frame's full-resolution pixels (m, 2) that were matched with any of them; `asked`: cells (CELLS,) that
    are looked at.
    """
    camera = graph.camera_on(island, graph.frames[frame].camera)
    agreeing = counts(np.concatenate([*matched, np.empty((0, 2))]), camera.width, camera.height) > 0
    full = full_cells(graph.frames[frame].features) & asked
    expected = full & _matched_before_by_any(graph, frame, pose, camera, others)
    if expected.sum() < ENOUGH_CELLS:
        expected = full & _seen_by_any(graph, pose, camera, others)
    return Confirmed(float(agreeing[expected].mean()) if expected.any() else 1.0, int(expected.sum()))


ENOUGH_CELLS = 6


def _matched_before_by_any(graph: ViewGraph, frame: int, pose: Pose, camera: Camera, others: Sequence[int]) -> Mask:
    """Cells (CELLS,) where others have features matched with frames other than this one, at similar resolution."""
    cells = _Cells.of(pose, camera)
    found = np.zeros(CELLS, bool)
    for other in others:
        view = graph.pose_of(other), graph.camera_of(other)
        pixels = graph.frames[other].features.points[graph.matched_before(other, but=frame)].astype(np.float64)
        there = pixels_from_canvas(pose, camera, canvas_from_pixels(*view, pixels))
        common = counts(there[_inside(there, camera)], camera.width, camera.height)
        found |= (common >= COMPARABLE) & cells.alike(view, pixels_from_canvas(*view, cells.places))
    return found


def _seen_by_any(graph: ViewGraph, pose: Pose, camera: Camera, others: Sequence[int]) -> Mask:
    """Cells (CELLS,) whose centre another frame sees at similar resolution."""
    cells = _Cells.of(pose, camera)
    seen = np.zeros(CELLS, bool)
    for other in others:
        view = graph.pose_of(other), graph.camera_of(other)
        pixels = pixels_from_canvas(*view, cells.places)
        seen |= _inside(pixels, view[1]) & cells.alike(view, pixels)
    return seen


def _inside(pixels: PointsNx2, camera: Camera) -> Mask:
    with np.errstate(invalid="ignore"):
        return np.asarray(((pixels >= 0) & (pixels < [camera.width, camera.height])).all(axis=1))


@dataclass(frozen=True, slots=True)
class _Cells:
    """The centres of a frame's cells on the canvas (CELLS, 2), and the ground sampling distance there."""

    places: PointsNx2
    resolution: Vector

    @classmethod
    def of(cls, pose: Pose, camera: Camera) -> Self:
        middles = centres(camera.width, camera.height)
        return cls(canvas_from_pixels(pose, camera, middles), ground_sampling_distance(pose, camera, middles))

    def alike(self, view: tuple[Pose, Camera], pixels: PointsNx2) -> Mask:
        """Where another frame, which has the centres at these pixels, sees at similar resolution."""
        with np.errstate(invalid="ignore"):
            ratio = ground_sampling_distance(*view, pixels) / self.resolution
            return np.asarray((ratio < SHARPER) & (ratio > 1 / SHARPER))
