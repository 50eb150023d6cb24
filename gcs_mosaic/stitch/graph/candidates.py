"""Match candidates of a frame: by position where known, by image retrieval where not."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from types import MappingProxyType

import cv2
import numpy as np
from numpy.typing import ArrayLike

from gcs_mosaic.stitch.arrays import Mask, Matrix3x3
from gcs_mosaic.stitch.camera.geometry import Camera, Pose, View, canvas_from_pixels, pixel_grid, pixels_from_canvas
from gcs_mosaic.stitch.features.extraction import Features
from gcs_mosaic.stitch.graph import neighbours
from gcs_mosaic.stitch.graph.observer import Observer
from gcs_mosaic.stitch.graph.silent_ground import note_found_again, telling
from gcs_mosaic.stitch.graph.view_graph import NOWHERE, ViewGraph, box_of, centres
from gcs_mosaic.stitch.registration.agreement import PixelPair
from gcs_mosaic.stitch.registration.by_pixels import should_have_matched
from gcs_mosaic.stitch.registration.confirmation import borne_out_where_telling
from gcs_mosaic.stitch.registration.frame_pair import ALL, MatchPart
from gcs_mosaic.stitch.registration.outcome import NO_PIXELS, NotRegistered, Registration
from gcs_mosaic.stitch.registration.proposals import Proposal
from gcs_mosaic.stitch.registration.registration import register
from gcs_mosaic.stitch.registration.settings import RegistrationSettings

# Frames whose overlap is computed, per neighbour wanted; bounding boxes alone mislead where headings differ.
PER_NEIGHBOUR = 4
AT_ONCE = 2  # frames matched in parallel
# Decades by which what else is known speaks for two frames lying as expected, where their pictures agree with it: the chance
# that a wrong pose leads to pixels that agree, within the tenth of a footprint by which poses may be off; and what one flight
# line in two gives, where the aircraft did not turn.
BY_POSE, BY_MOTION = 4.0, 2.0
IN_SEQUENCE = 2  # frames between whose capture at most one other lies follow each other
LOOKED_AT = 2  # frames beside which one that keypoints do not bear out is looked at


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchSettings:
    """Which frames a new frame is matched with."""

    # Frames a new one is matched with. With 12 no recorded flight is better, and placing costs 1.4 times as much; with 8 copr is
    # a tenth farther from its reference.
    neighbours: int = 10
    first_tries: int = 4  # frames near the last one tried before retrieval
    wide_tries: int = 6  # best retrieval results matched in full
    least_overlap: float = 0.05  # share of a frame below which matching is not worth the time


class Search:
    """Searches for links between the frames of a graph."""

    def __init__(
        self,
        graph: ViewGraph,
        settings: SearchSettings,
        registration: RegistrationSettings,
        observer: Observer | None = None,
    ) -> None:
        self._graph = graph
        self._settings = settings
        self._registration = registration
        self._observer = observer
        self._pool = ThreadPoolExecutor(AT_ONCE, thread_name_prefix="register")

    def first_links(
        self, frame: int, last: int, compared: Mapping[int, Registration | None] = MappingProxyType({})
    ) -> Iterator[tuple[int, Registration]]:
        """Placed frames that this one registers with, likeliest first; `last`: the frame placed last.

        `compared`: results of comparisons already made.
        """
        tried: set[int] = set()
        for other in self._candidates(frame, last):
            if other not in tried:
                tried.add(other)
                registration = compared[other] if other in compared else self.register(frame, other)
                if registration is not None and other in compared:
                    note_found_again(self._graph, frame, other, registration)
                if registration is not None:
                    yield other, registration

    def _candidates(self, frame: int, last: int) -> Iterator[int]:
        yield from self._nearby(last)
        yield from self.likeliest(frame, self._graph.placed())

    def likeliest(self, frame: int, among: ArrayLike, count: int | None = None) -> list[int]:
        """Frames most similar to this one, best first."""
        others = np.asarray(among, dtype=np.intp)
        others = others[others != frame]
        features = self._graph.frames[frame].features
        return self._graph.retrieval.likeliest(features, others, self._settings.wide_tries if count is None else count)

    def register(self, frame: int, other: int) -> Registration | None:
        """Register two frames whose relative position is unknown."""
        a, b = self._graph.frames[frame].features, self._graph.frames[other].features
        part_a, part_b = (MatchPart(again=self._graph.matched_before(f)) for f in (frame, other))
        expected, in_sequence = self._by_last_motion(a, other), _in_sequence(frame, other)
        found = register(a, b, self._registration, part_a, part_b, expected, in_sequence=in_sequence)
        return self._told(frame, other, self._heard(frame, a, other, found, part_a, part_b))

    def register_as(self, frame: int, a: Features, other: int, b: Features) -> Registration | None:
        """Register two frames by other features than the graph has of them."""
        return self._told(frame, other, register(a, b, self._registration, expected=self._by_last_motion(a, other)))

    def compare(self, name: str, features: Features, other: int) -> Registration | None:
        """Register a frame that is not in the graph yet with one that is; same result as `register` later."""
        part = MatchPart(again=self._graph.matched_before(other))
        expected = self._by_last_motion(features, other)
        b, in_sequence = self._graph.frames[other].features, _in_sequence(len(self._graph.frames), other)
        found = register(features, b, self._registration, part_b=part, expected=expected, in_sequence=in_sequence)
        return self._told_of(name, other, self._heard(None, features, other, found, ALL, part))

    def neighbour_links(
        self, frame: int, pose: Pose, island: int, most: int | None = None
    ) -> dict[int, Registration | None]:
        """Registrations of a frame at a rough pose with the frames it should overlap, or with the `most` likely, spread over all
        directions; None where registration failed."""
        view = pose, self._graph.camera_on(island, self._graph.frames[frame].camera)
        known = self._graph.frames[frame].inliers
        others = [other for other in self._overlapping(frame, *view, island) if other not in known][:most]
        again = self._graph.matched_before(frame)
        found = self._pool.map(lambda other: self._registered_in_place(frame, view, again, other), others)
        return {other: self._told(frame, other, one) for other, one in zip(others, found, strict=True)}

    def pixels_bear_out(self, frame: int, pose: Pose, island: int, links: Mapping[int, Registration | None]) -> float:
        """Evidence, in decades, of the pictures of a frame at this pose and of those that it overlaps most, beyond what was
        matched: two places that have something in common differ in the rest. 0 where they do not agree."""
        graph = self._graph
        view = pose, graph.camera_on(island, graph.frames[frame].camera)
        views = {other: (graph.pose_of(other), graph.camera_of(other)) for other in links}
        shared = {other: neighbours.overlap(*view, *views[other]) for other in links}
        most = sorted(links, key=lambda other: (-shared[other], other))[:LOOKED_AT]
        found = [self._agreement(frame, view, other, views[other], links[other]) for other in most]
        return min(found, default=0.0)

    def _agreement(self, frame: int, view_a: View, other: int, view_b: View, link: Registration | None) -> float:
        a, b = self._features_of(frame), self._features_of(other)
        pair = PixelPair(a, b)
        expected = homography_between(view_a, view_b) if pair.known else None
        found = None if expected is None else pair.agreement(expected)
        if found is None or found.alone < self._registration.least_alone or should_have_matched(found, pair, a, b):
            return 0.0
        beyond = pair.evidence_beyond(found, NO_PIXELS if link is None else link.agreeing_a)
        evidence = min(found.evidence, beyond)
        return evidence if evidence >= self._registration.least_beyond else 0.0

    @property
    def thorough(self) -> Search:
        """A search whose `neighbour_links` leave out no frame: what refutes a pose are pairs that should overlap and do not
        register."""
        return self

    def _nearby(self, last: int) -> list[int]:
        """The last placed frame, then those that meet its region of interest, nearest first."""
        graph = self._graph
        region = neighbours.region_of_interest(graph.boxes[last])
        here = graph.members(graph.island_of(last))
        here = here[neighbours.boxes_meet(region, graph.boxes[here])]
        far = np.linalg.norm(centres(graph.boxes[here]) - centres(graph.boxes[[last]]), axis=1)
        order = [int(here[i]) for i in np.argsort(far, kind="stable") if here[i] != last]
        return [last, *order][: self._settings.first_tries]

    def _overlapping(self, frame: int, pose: Pose, camera: Camera, island: int) -> list[int]:
        """Frames of the island that overlap this pose, spread over all directions, the best of each first.

        A climb puts hundreds of frames inside the box of one: boxes preselect those whose overlap is computed.
        """
        graph, count = self._graph, self._settings.neighbours
        box = box_of(pose, camera)
        members = graph.members(island)
        members = members[(members != frame) & neighbours.boxes_meet(box, graph.boxes[members])]
        away = centres(graph.boxes[members]) - centres(box[None])
        bearings = np.arctan2(away[:, 1], away[:, 0])
        roughly = neighbours.boxes_shared(box, graph.boxes[members])
        likely = neighbours.spread_choice(roughly, bearings, PER_NEIGHBOUR * count)
        members, bearings = members[likely], bearings[likely]
        shared = np.array([neighbours.overlap(pose, camera, graph.pose_of(o), graph.camera_of(o)) for o in members])
        keep = shared >= self._settings.least_overlap
        chosen = neighbours.spread_choice(shared[keep], bearings[keep], count)
        return [int(f) for f in members[keep][chosen]]

    def _registered_in_place(self, frame: int, view_a: View, again: Mask, other: int) -> Registration | NotRegistered:
        """Register two frames by the features that both should see, as far as their poses are known; `again`: those of the first
        that were matched before."""
        graph = self._graph
        a, b = self._features_of(frame), self._features_of(other)
        view_b = graph.pose_of(other), graph.camera_of(other)
        seen_a = neighbours.seen_by(a.points.astype(np.float64), *view_a, *view_b)
        seen_b = neighbours.seen_by(b.points.astype(np.float64), *view_b, *view_a)
        part_a = MatchPart(seen_a, again)
        part_b = MatchPart(seen_b, graph.matched_before(other))
        expected = homography_between(view_a, view_b)
        proposals = [] if expected is None else [Proposal(expected, BY_POSE)]
        found = register(a, b, self._registration, part_a, part_b, proposals)
        return self._heard(frame, a, other, found, part_a, part_b)

    def _heard(
        self,
        frame: int | None,
        features: Features,
        other: int,
        found: Registration | NotRegistered,
        part: MatchPart,
        part_of_other: MatchPart,
    ) -> Registration | NotRegistered:
        """Without the witness of ground that is never found again, of frames that it contradicts."""
        if isinstance(found, Registration):
            return found
        graph, b = self._graph, self._features_of(other)
        return borne_out_where_telling(
            found,
            features,
            b,
            self._registration,
            (part, part_of_other),
            lambda: (telling(graph, features, frame), telling(graph, b, frame)),
        )

    def _by_last_motion(self, features: Features, other: int) -> list[Proposal]:
        """Where a frame should lie on the one placed last if the aircraft went on as it did between the two before."""
        graph = self._graph
        last, before = graph.last_placed, graph.placed_before
        if other != last or before is None or graph.islands[before] != graph.islands[last]:
            return []
        shapes = {(graph.frames[one].features.width, graph.frames[one].features.height) for one in (last, before)}
        if shapes != {(features.width, features.height)} or graph.islands[last] == NOWHERE:
            return []
        of_last, of_before = ((graph.pose_of(one), graph.camera_of(one)) for one in (last, before))
        expected = homography_between(of_last, of_before)
        # Twice as far if a frame in between is missing.
        return [] if expected is None else [Proposal(expected, BY_MOTION), Proposal(expected @ expected, BY_MOTION)]

    def _features_of(self, frame: int) -> Features:
        return self._graph.frames[frame].features

    def _told(self, frame: int, other: int, found: Registration | NotRegistered) -> Registration | None:
        if isinstance(found, Registration):
            note_found_again(self._graph, frame, other, found)
        return self._told_of(self._graph.frames[frame].name, other, found)

    def _told_of(self, name: str, other: int, found: Registration | NotRegistered) -> Registration | None:
        if self._observer:
            self._observer.registered(name, self._graph.frames[other].name, found)
        return found if isinstance(found, Registration) else None


def _in_sequence(frame: int, other: int) -> bool:
    return abs(frame - other) <= IN_SEQUENCE


def homography_between(view_a: View, view_b: View) -> Matrix3x3 | None:
    """The homography (3x3) from frame a to frame b that fits their poses and lenses best; None if they share no ground."""
    pixels = pixel_grid(view_a[1], 7, 5)
    there = pixels_from_canvas(*view_b, canvas_from_pixels(*view_a, pixels))
    with np.errstate(invalid="ignore"):
        inside = ((there >= 0) & (there < [view_b[1].width, view_b[1].height])).all(axis=1)
    if inside.sum() < SHARED_POINTS:
        return None
    found, _ = cv2.findHomography(pixels[inside], there[inside], 0)
    return None if found is None or not np.isfinite(found).all() else np.asarray(found, np.float64)


SHARED_POINTS = 6  # of a grid of 35
