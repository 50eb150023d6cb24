"""Resection: from a frame's first link, via its neighbours, to its pose."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from gcs_mosaic.stitch.bundle.certainty import note_resected
from gcs_mosaic.stitch.bundle.island import Resected, adjust_island, level_pose_over, resect
from gcs_mosaic.stitch.bundle.levenberg_marquardt import AdjustmentSettings
from gcs_mosaic.stitch.bundle.relief import note_relief
from gcs_mosaic.stitch.camera import geometry
from gcs_mosaic.stitch.camera.geometry import Pose
from gcs_mosaic.stitch.graph.candidates import Search
from gcs_mosaic.stitch.graph.overlap_check import odds_around
from gcs_mosaic.stitch.graph.view_graph import LENS_KNOWN, ViewGraph
from gcs_mosaic.stitch.registration.outcome import Registration
from gcs_mosaic.stitch.transaction import attempt

UNKNOWN_LENS = 3.0  # factor on the residual limit until then


@dataclass(frozen=True, slots=True, kw_only=True)
class PlausibilitySettings:
    """Limits of plausible placements."""

    least_features: int = 40  # an image with fewer is not placed
    # maximum median residual of a placement, pixels of the feature picture
    most_residual_px: float = 4.0
    most_deviation: float = 0.05  # of a corner, in half-diagonals; a pose with more is undetermined
    steepest_tilt_deg: float = 80.0  # from the vertical; beyond it a frame shows hardly any ground
    largest_zoom: float = 5.0  # largest accepted change of height relative to a linked frame
    # log10 likelihood ratio of a true pose to a look-alike, from the confirmed cells around the frame: below this it is
    # refused; slightly negative, because the registered pair already supports it
    least_log_odds: float = -0.5


@dataclass(frozen=True, slots=True)
class Disbelief:
    """A rejected pose, and why."""

    reason: str


class Placing:
    """Finds poses for the frames of a graph."""

    def __init__(
        self, graph: ViewGraph, search: Search, plausibility: PlausibilitySettings, adjustment: AdjustmentSettings
    ) -> None:
        self._graph = graph
        self._search = search
        self._plausibility = plausibility
        self._adjustment = adjustment

    def pose_beside(self, frame: int, other: int, registration: Registration) -> Pose | Disbelief:
        """The pose of a frame registered with a placed one; links it with all frames it overlaps.

        No change if the pose is rejected.
        """
        with attempt(self._graph) as trial:
            found = self._pose_beside(frame, other, registration)
            if isinstance(found, Pose):
                trial.keep()
        return found

    def _pose_beside(self, frame: int, other: int, registration: Registration) -> Pose | Disbelief:
        island = self._graph.island_of(other)
        self._graph.link(frame, other, registration.proved)
        found = self._believable_pose(frame, self._rough_poses(frame, other, registration), island)
        if isinstance(found, Disbelief):
            return found
        links = {other: registration, **self._search.neighbour_links(frame, found, island)}
        matched = {neighbour: link for neighbour, link in links.items() if link is not None}
        for neighbour, link in matched.items():
            self._graph.link(frame, neighbour, link)
        found = self._believable_pose(frame, [found], island)
        if isinstance(found, Disbelief):
            return found
        return self._borne_out(frame, found, island, links)

    def _borne_out(
        self, frame: int, pose: Pose, island: int, links: Mapping[int, Registration | None]
    ) -> Pose | Disbelief:
        """The pose, if the frame confirms what the other frames see around it, by keypoints or by pixels."""
        graph, least = self._graph, self._plausibility.least_log_odds
        found, odds = odds_around(graph, frame, pose, island, links, least)
        if odds < least:
            odds += self._search.pixels_bear_out(frame, pose, island, links)
        if odds < least:
            return Disbelief(f"only {found.share:.0%} of what it should show was found in it")
        graph.note_believed(found.cells, found.share)
        return pose

    def note_relief(self, frame: int) -> None:
        """Compute the relief displacement of a frame that has just been placed."""
        note_relief(self._graph, frame, self._adjustment.relief)

    def _rough_poses(self, frame: int, other: int, registration: Registration) -> list[Pose]:
        """Initial poses from one link: level, as most frames are, and tilted according to the homography."""
        pose, camera = self._graph.pose_of(other), self._graph.camera_of(other)
        places = geometry.canvas_from_pixels(pose, camera, registration.pixels_b)
        on_ground = np.isfinite(places).all(axis=1)
        if on_ground.sum() < 4:
            return []
        own = self._graph.camera_on(self._graph.island_of(other), self._graph.frames[frame].camera)
        homography = geometry.pinhole_homography(pose, camera) @ registration.b_from_a
        tilted = geometry.pose_from_homography(homography, own)
        return [
            level_pose_over(own, registration.pixels_a[on_ground], places[on_ground]),
            *([tilted] if tilted else []),
        ]

    def _believable_pose(self, frame: int, rough: list[Pose], island: int) -> Pose | Disbelief:
        """The frame's best pose on an island by its links, from any of the rough ones, if plausible."""
        found = [resect(self._graph, frame, pose, island, self._adjustment) for pose in rough]
        best = min(found, key=lambda resected: resected.residual_px, default=None)
        if best is None:
            return Disbelief("what it has in common with the other lies above its horizon")
        doubt = self._doubt(frame, best, island)
        if not doubt:
            note_resected(self._graph, frame, best.pose, best.corner_deviation_px)
            return best.pose
        return self._pose_with_all_free(frame, best.pose, island) or Disbelief(doubt)

    def _pose_with_all_free(self, frame: int, rough: Pose, island: int) -> Pose | None:
        """As above on an island of a few frames, whose own tilt and lens are as uncertain as the new frame's pose."""
        graph = self._graph
        others = [member for member in graph.members(island).tolist() if member != frame]
        if len(others) >= LENS_KNOWN:
            return None
        graph.put(frame, rough, island)
        adjust_island(graph, island, self._adjustment)
        state = graph.frames[frame]
        fits = state.residual_px <= self._plausibility.most_residual_px * state.features.scale
        possible = not any(self._impossible(member, graph.pose_of(member)) for member in [frame, *others])
        return state.pose if fits and possible else None

    def _doubt(self, frame: int, resected: Resected, island: int) -> str:
        """Reason why a pose does not fit its links, is undetermined by them or impossible; or ""."""
        settings = self._plausibility
        most_px = self._residual_limit(frame, island)
        if not resected.residual_px <= most_px:
            return f"misses its matches by {resected.residual_px:.1f} px, {most_px:.1f} allowed"
        camera = self._graph.camera_on(island, self._graph.frames[frame].camera)
        most_deviation_px = settings.most_deviation * camera.half_diagonal
        if not resected.cautious_deviation_px <= most_deviation_px:
            return f"a corner is only known to {resected.cautious_deviation_px:.0f} px, {most_deviation_px:.0f} allowed"
        return self._impossible(frame, resected.pose)

    def _impossible(self, frame: int, pose: Pose) -> str:
        """Reason why the pose is physically implausible, or ""."""
        settings = self._plausibility
        tilt_deg = math.degrees(math.acos(max(-1.0, math.cos(pose.pitch) * math.cos(pose.roll))))
        if not tilt_deg <= settings.steepest_tilt_deg:
            return f"tilted by {tilt_deg:.0f} degrees"
        linked = [self._graph.frames[other].pose for other in self._graph.frames[frame].inliers]
        zoom = math.exp(max((abs(pose.log_gsd - other.log_gsd) for other in linked if other), default=0.0))
        return "" if zoom <= settings.largest_zoom else f"change of height by {zoom:.1f}"

    def _residual_limit(self, frame: int, island: int) -> float:
        """Pixels of the feature picture. While few frames determine the lens, even good matches fit badly."""
        shown = self._graph.count_with_camera(island, self._graph.frames[frame].camera, LENS_KNOWN)
        limit = self._plausibility.most_residual_px
        return limit * (UNKNOWN_LENS if shown < LENS_KNOWN else 1)
