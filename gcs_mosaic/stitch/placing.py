"""Where a frame lies, once it is known to overlap another: from the first link, through its neighbours, to its pose."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from gcs_mosaic.stitch import geometry
from gcs_mosaic.stitch.adjusting.adjustment import AdjustmentSettings
from gcs_mosaic.stitch.adjusting.certainty import note_resected
from gcs_mosaic.stitch.adjusting.solving import Resected, adjust_island, level_pose_over, resect
from gcs_mosaic.stitch.geometry import Camera, Pose
from gcs_mosaic.stitch.matching.registration import Registration
from gcs_mosaic.stitch.matching.witnesses import MAJORITY, confirmed_share
from gcs_mosaic.stitch.network import Network
from gcs_mosaic.stitch.relief.estimation import note_relief
from gcs_mosaic.stitch.search import Search

LENS_KNOWN = 5  # frames after which a lens is known well enough to judge residuals
UNKNOWN_LENS = 3.0  # how much larger residuals may be before that


@dataclass(frozen=True, slots=True, kw_only=True)
class PlausibilitySettings:
    """What is not believed of a placement."""

    least_features: int = 40  # a picture with fewer shows nothing to hold on to
    # median residual above which a placement is not believed, pixels of the feature picture
    most_residual_px: float = 4.0
    most_deviation: float = 0.05  # of a corner, in half-diagonals, beyond which a pose counts as not determined
    steepest_tilt_deg: float = 80.0  # from straight down; beyond it a frame shows next to no ground
    largest_zoom: float = 5.0  # change of height against a linked frame that is still believed


@dataclass(frozen=True, slots=True)
class Disbelief:
    """A pose that is not to be believed, and why."""

    reason: str


class Placing:
    """Finds poses for the frames of a network."""

    def __init__(
        self, network: Network, search: Search, plausibility: PlausibilitySettings, adjustment: AdjustmentSettings
    ) -> None:
        self._network = network
        self._search = search
        self._plausibility = plausibility
        self._adjustment = adjustment

    def pose_beside(self, frame: int, other: int, registration: Registration) -> Pose | Disbelief:
        """The pose of a frame that was registered with a placed one, and its links with all that it overlaps.

        Links are kept only if the result is to be believed.
        """
        island = self._network.island_of(other)
        before = self._as_it_is(island)
        self._network.link(frame, other, registration)
        found = self._believable_pose(frame, self._rough_poses(frame, other, registration))
        if isinstance(found, Pose):
            links = {other: registration, **dict(self._search.neighbour_links(frame, found, island))}
            matched = {neighbour: link for neighbour, link in links.items() if link is not None}
            for neighbour, link in matched.items():
                self._network.link(frame, neighbour, link)
            found = self._believable_pose(frame, [found])
            if isinstance(found, Pose):
                found = self._borne_out(frame, found, list(links), list(matched.values()))
        if isinstance(found, Disbelief):
            self._network.take_back(frame)
            self._restore(island, before)
        return found

    def _as_it_is(self, island: int) -> tuple[list[Camera], dict[int, Pose]]:
        """Lenses and poses that a frame may change before it is believed: those of an island of a few frames."""
        few = self._network.members(island).tolist() if self._network.count_members(island) < LENS_KNOWN else []
        return list(self._network.cameras), {member: self._network.pose_of(member) for member in few}

    def _restore(self, island: int, before: tuple[list[Camera], dict[int, Pose]]) -> None:
        cameras, poses = before
        self._network.cameras[:] = cameras
        for member, pose in poses.items():
            self._network.put(member, pose, island)

    def _borne_out(self, frame: int, pose: Pose, others: list[int], matched: list[Registration]) -> Pose | Disbelief:
        """The pose, if what the other frames see around it was found in the frame."""
        share = confirmed_share(self._network, frame, pose, others, [link.pixels_a for link in matched])
        return pose if share > MAJORITY else Disbelief(f"only {share:.0%} of what it should show was found in it")

    def note_relief(self, frame: int) -> None:
        """Measure the relief displacement of a frame that has just been put at its pose."""
        note_relief(self._network, frame, self._adjustment.relief)

    def _rough_poses(self, frame: int, other: int, registration: Registration) -> list[Pose]:
        """First poses from one link: level, as most frames are, and tilted as the homography says."""
        pose, camera = self._network.pose_of(other), self._network.camera_of(other)
        places = geometry.canvas_from_pixels(pose, camera, registration.pixels_b)
        on_ground = np.isfinite(places).all(axis=1)
        if on_ground.sum() < 4:
            return []
        own = self._network.camera_of(frame)
        homography = geometry.pinhole_homography(pose, camera) @ registration.b_from_a
        tilted = geometry.pose_from_homography(homography, own)
        return [
            level_pose_over(own, registration.pixels_a[on_ground], places[on_ground]),
            *([tilted] if tilted else []),
        ]

    def _believable_pose(self, frame: int, rough: list[Pose]) -> Pose | Disbelief:
        """The frame's best pose against its links from any of the rough ones, if it is to be believed."""
        found = [resect(self._network, frame, pose, self._adjustment) for pose in rough]
        best = min(found, key=lambda resected: resected.residual_px, default=None)
        if best is None:
            return Disbelief("what it has in common with the other lies above its horizon")
        doubt = self._doubt(frame, best)
        if not doubt:
            note_resected(self._network, frame, best.pose, best.corner_deviation_px)
            return best.pose
        return self._pose_with_all_free(frame, best.pose) or Disbelief(doubt)

    def _pose_with_all_free(self, frame: int, rough: Pose) -> Pose | None:
        """The same on an island of a few frames, whose own tilt and lens are as open as the new frame's pose."""
        network = self._network
        island = network.island_of(next(iter(network.frames[frame].inliers)))
        others = [member for member in network.members(island).tolist() if member != frame]
        if len(others) >= LENS_KNOWN:
            return None
        network.put(frame, rough, island)
        adjust_island(network, island, self._adjustment)
        state = network.frames[frame]
        fits = state.residual_px <= self._plausibility.most_residual_px * state.features.scale
        possible = not any(self._impossible(member, network.pose_of(member)) for member in [frame, *others])
        return state.pose if fits and possible else None

    def _doubt(self, frame: int, resected: Resected) -> str:
        """Why a pose does not fit its links, is not determined by them, or is none that an aircraft can have; or nothing."""
        settings = self._plausibility
        most_px = self._residual_limit(frame)
        if not resected.residual_px <= most_px:
            return f"misses its matches by {resected.residual_px:.1f} px, {most_px:.1f} allowed"
        most_deviation_px = settings.most_deviation * self._network.camera_of(frame).half_diagonal
        if not resected.cautious_deviation_px <= most_deviation_px:
            return f"a corner is only known to {resected.cautious_deviation_px:.0f} px, {most_deviation_px:.0f} allowed"
        return self._impossible(frame, resected.pose)

    def _impossible(self, frame: int, pose: Pose) -> str:
        """Why no aircraft can have been there, or nothing."""
        settings = self._plausibility
        tilt_deg = math.degrees(math.acos(max(-1.0, math.cos(pose.pitch) * math.cos(pose.roll))))
        if not tilt_deg <= settings.steepest_tilt_deg:
            return f"tilted by {tilt_deg:.0f} degrees"
        linked = [self._network.frames[other].pose for other in self._network.frames[frame].inliers]
        zoom = math.exp(max((abs(pose.log_gsd - other.log_gsd) for other in linked if other), default=0.0))
        return "" if zoom <= settings.largest_zoom else f"change of height by {zoom:.1f}"

    def _residual_limit(self, frame: int) -> float:
        """Pixels of the feature picture. While few frames have shown what the lens is like, even good matches fit badly."""
        shown = self._network.count_placed(self._network.frames[frame].camera, LENS_KNOWN)
        limit = self._plausibility.most_residual_px
        return limit * (UNKNOWN_LENS if shown < LENS_KNOWN else 1)
