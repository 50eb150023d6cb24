"""Islands: parts of the map not (yet) connected, and the evidence for merging two of them.

A wrong merge is worse than none. A registered pair of frames of two islands (a bridge) gives their relative pose; chance alone
does not produce one (`a_contrario`), but look-alikes do, whatever the number of matches. So a bridge is a hypothesis: it is
tested where the islands should overlap, and the results must agree, on different ground and between different frames, until the
evidence suffices.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gcs_mosaic.stitch.arrays import PointsNx2, SquareMatrix, Vector, Vector2
from gcs_mosaic.stitch.bundle.lens import believable
from gcs_mosaic.stitch.camera.geometry import canvas_from_pixels, moved_by_similarity, similarity_between
from gcs_mosaic.stitch.camera.projection import lens_terms, with_lens
from gcs_mosaic.stitch.graph.candidates import Search
from gcs_mosaic.stitch.graph.neighbours import boxes_meet, boxes_shared
from gcs_mosaic.stitch.graph.overlap_check import odds_around
from gcs_mosaic.stitch.graph.view_graph import Bridge, CameraNumber, Lens, ViewGraph, box_of, centres
from gcs_mosaic.stitch.registration.a_contrario import SAMPLE

Similarity = tuple[float, float, Vector2]  # scale, angle in radians, shift (2,)

AGREEMENT = 0.1  # of a footprint's diagonal: maximum distance between two bridges' places of the same ground
# -log10 of the chance that two wrong bridges agree so well: 0.007 in position (3 x 3 footprints), 0.06 in heading (0.2 radians
# either way), 0.1 in scale (20 % of a factor of 5 either way).
LOG_AGREEMENT = 4.0
# Maximum evidence of one bridge, in decades: none of 1,900 registered pairs of the recorded flights was wrong, but over
# identical halls one unrelated pair in five is registered.
LOG_BRIDGE = 2.0
# Of a footprint's diagonal: closer than this, the matches of two bridges may lie on the same object.
APART = 0.25
MUCH = 0.5  # overlap of a frame of the smaller island with the larger one above which it can test a bridge
WITNESSES = 3  # frames of the smaller island whose overlap is tested
PAIRS_PER_WITNESS = 6  # frames of the larger one that each of them is matched with
TELLING_CELLS = 6  # cells of a witness that matches could confirm; with fewer, one by chance would decide


@dataclass(frozen=True, slots=True, kw_only=True)
class IslandSettings:
    """When islands are merged."""

    # -log10 of the chance that a merge is wrong: two agreeing bridges give 8, one whatever its matches 2, a frame confirmed
    # everywhere by the other island's view of its ground about 5, one confirmed in a quarter of it 3.2
    least_evidence: float = 3.0
    # frames of other islands, or waiting, that each one is compared with when idle and at the end: 0.03 s each
    tries_in_a_pause: int = 8


@dataclass(frozen=True, slots=True)
class Island:
    """A part of the map; `merged_into`: the island it was merged into."""

    number: int
    merged_into: int | None = None


class Bridges:
    """Evaluates the evidence between islands and merges them where it suffices."""

    def __init__(self, graph: ViewGraph, search: Search, settings: IslandSettings) -> None:
        self._graph = graph
        self._search = search
        self._settings = settings

    @property
    def tries_in_a_pause(self) -> int:
        return self._settings.tries_in_a_pause

    def add(self, newest: Bridge) -> list[Bridge]:
        """Keep a bridge; returns all that agree with it, side a on the larger island, if they justify merging."""
        sides = [self._graph.island_of(newest.frame_a), self._graph.island_of(newest.frame_b)]
        stays, goes = sorted(sides, key=lambda island: (-self._graph.count_members(island), island))
        newest = self._from_side(newest, stays)
        self._forget(newest)
        if not self._agree(newest, newest):
            return []  # its own matches fit no similarity: the frames' poses are inconsistent
        known = [*(b for b in self._between(stays, goes) if self._agree(b, newest)), newest]
        looked_for, odds = self._look_into_overlap(stays, goes, known)
        self._graph.bridges.append(newest)
        # What was looked for where the known bridges lead agrees with them, right or wrong: it only counts for the odds.
        if odds < 0 or self._evidence(known) + odds < self._settings.least_evidence:
            return []
        return [*known, *(bridge for bridge in looked_for if self._agree(bridge, newest))]

    def join(self, bridges: list[Bridge]) -> tuple[int, int]:
        """Move the smaller island onto the larger one by these bridges. Returns (remaining island, merged island)."""
        graph = self._graph
        stays, goes = graph.island_of(bridges[0].frame_a), graph.island_of(bridges[0].frame_b)
        stays_from_goes = self._similarity(bridges)
        members = graph.members(goes).tolist()
        moved = [moved_by_similarity(graph.pose_of(frame), *stays_from_goes) for frame in members]
        graph.put_all(members, moved, stays, self._reconciled_lenses(stays, goes))
        for frame in members:
            graph.note(frame, drawn=None)
        for bridge in bridges:
            graph.link(bridge.frame_a, bridge.frame_b, bridge.registration)
        graph.merge(goes, stays)
        return stays, goes

    def _reconciled_lenses(self, stays: int, goes: int) -> dict[CameraNumber, Lens]:
        """Lenses of the merged island's cameras, combined with those of the other by information: initial values for the joint
        adjustment."""
        lenses = self._graph.lenses
        return {
            number: _reconciled(lenses[stays, number], lens) if (stays, number) in lenses else lens
            for (island, number), lens in lenses.items()
            if island == goes
        }

    def _forget(self, newest: Bridge) -> None:
        """Drop an earlier bridge between the same two frames: it would count twice."""
        ends = {newest.frame_a, newest.frame_b}
        self._graph.bridges = [b for b in self._graph.bridges if {b.frame_a, b.frame_b} != ends]

    def _between(self, stays: int, goes: int) -> list[Bridge]:
        """All bridges between two islands, side a on the first."""
        return [
            self._from_side(bridge, stays)
            for bridge in self._graph.bridges
            if {self._graph.island_of(bridge.frame_a), self._graph.island_of(bridge.frame_b)} == {stays, goes}
        ]

    def _from_side(self, bridge: Bridge, island: int) -> Bridge:
        return bridge if self._graph.island_of(bridge.frame_a) == island else bridge.turned()

    def _look_into_overlap(self, stays: int, goes: int, known: list[Bridge]) -> tuple[list[Bridge], float]:
        """Match frames that should overlap if the known bridges are right.

        Returns the bridges found, and the log odds of a true overlap from the worst witness, or the first that refutes it. A
        witness that sees too little counts as 0: it refutes nothing, and the bridges alone must justify merging.
        """
        graph, stays_from_goes = self._graph, self._similarity(known)
        found: list[Bridge] = []
        odds: list[float] = []
        for witness in self._witnesses(stays, goes, stays_from_goes, known):
            pose = moved_by_similarity(graph.pose_of(witness), *stays_from_goes)
            links = self._search.thorough.neighbour_links(witness, pose, stays, PAIRS_PER_WITNESS)
            links |= {bridge.frame_a: bridge.registration.turned() for bridge in known if bridge.frame_b == witness}
            matched = {other: link for other, link in links.items() if link is not None}
            around, of_witness = odds_around(graph, witness, pose, stays, links, 0.0)
            odds.append(of_witness if around.cells >= TELLING_CELLS else 0.0)
            if odds[-1] < 0:
                odds[-1] += self._search.pixels_bear_out(witness, pose, stays, links)
            if odds[-1] < 0:
                break  # refuted, whatever others see
            here = {bridge.frame_a for bridge in known if bridge.frame_b == witness}
            found += [Bridge(witness, other, link).turned() for other, link in matched.items() if other not in here]
        return found, min(odds)

    def _witnesses(self, stays: int, goes: int, stays_from_goes: Similarity, known: list[Bridge]) -> list[int]:
        """The newest bridge's frame, and the nearest ones that should see much of the other island.

        Distant ones would be as informative, but an island not merged yet may be bent.
        """
        graph, members, newest = self._graph, self._graph.members(goes).tolist(), known[-1].frame_b
        moved = {f: moved_by_similarity(graph.pose_of(f), *stays_from_goes) for f in members}
        boxes = {f: box_of(pose, graph.camera_of(f)) for f, pose in moved.items()}
        others = graph.boxes[graph.members(stays)]
        shared = {f: boxes_shared(box, others[boxes_meet(box, others)]).max(initial=0.0) for f, box in boxes.items()}
        inside = [f for f, share in shared.items() if share > MUCH and f != newest]
        away = {f: float(np.linalg.norm(centres(boxes[f][None]) - centres(boxes[newest][None]))) for f in inside}
        return [newest, *sorted(inside, key=away.__getitem__)[: WITNESSES - 1]]

    def _evidence(self, bridges: list[Bridge]) -> float:
        """-log10 of the chance that these bridges are wrong and yet agree, from the independent ones."""
        independent = max((self._independent_of(first, bridges) for first in bridges), key=len)
        of_each = sum(min(bridge.registration.evidence, LOG_BRIDGE) for bridge in independent)
        return of_each + LOG_AGREEMENT * (len(independent) - 1)

    def _independent_of(self, first: Bridge, bridges: list[Bridge]) -> list[Bridge]:
        """The bridge and, strongest first, others independent of it and of each other."""
        chosen = [first]
        for bridge in sorted(bridges, key=lambda b: -b.registration.evidence):
            if all(self._are_independent(bridge, other) for other in chosen):
                chosen.append(bridge)
        return chosen

    def _are_independent(self, one: Bridge, other: Bridge) -> bool:
        """Whether two bridges share no frame and their matches lie on different ground."""
        if one.frame_a == other.frame_a or one.frame_b == other.frame_b:
            return False
        middles = [np.median(self._places(bridge)[0], axis=0) for bridge in (one, other)]
        return bool(np.linalg.norm(middles[0] - middles[1]) > APART * self._diagonal(one.frame_a))

    def _agree(self, first: Bridge, second: Bridge) -> bool:
        """Whether two bridges place island b consistently on island a; one that sees no ground agrees with none."""
        if min(len(self._places(bridge)[0]) for bridge in (first, second)) < SAMPLE:
            return False
        return all(
            self._misfit(self._similarity([bridge]), other) < AGREEMENT * self._diagonal(bridge.frame_a)
            for bridge, other in ((first, second), (second, first))
        )

    def _misfit(self, a_from_b: Similarity, bridge: Bridge) -> float:
        """Median residual of another bridge's matches under a similarity, canvas units of island a."""
        scale, angle, shift = a_from_b
        c, s = np.cos(angle), np.sin(angle)
        places_a, places_b = self._places(bridge)
        moved = scale * places_b @ np.array([[c, s], [-s, c]]) + shift
        return float(np.median(np.linalg.norm(moved - places_a, axis=1)))

    def _similarity(self, bridges: list[Bridge]) -> Similarity:
        """Similarity from island b to island a that fits these bridges jointly."""
        places = [self._places(bridge) for bridge in bridges]
        return similarity_between(np.concatenate([b for _, b in places]), np.concatenate([a for a, _ in places]))

    def _places(self, bridge: Bridge) -> tuple[PointsNx2, PointsNx2]:
        """Places (m, 2) of the matches on either island, at the present poses."""
        graph, r = self._graph, bridge.registration
        places_a, places_b = (
            canvas_from_pixels(graph.pose_of(frame), graph.camera_of(frame), pixels)
            for frame, pixels in ((bridge.frame_a, r.pixels_a), (bridge.frame_b, r.pixels_b))
        )
        seen = np.isfinite(places_a).all(axis=1) & np.isfinite(places_b).all(axis=1)
        return places_a[seen], places_b[seen]

    def _diagonal(self, frame: int) -> float:
        box = self._graph.boxes[frame]
        return float(np.linalg.norm(box[2:] - box[:2]))


def _reconciled(one: Lens, other: Lens) -> Lens:
    """Mean of two lenses of a camera, weighted by information (none if never estimated). If the mean is outside the lens limits,
    or only one is a fisheye, the better known one."""
    if one.information is None or other.information is None:
        return other if one.information is None and other.information is not None else one
    information, fisheye = one.information + other.information, np.array([one.camera.fisheye])
    weighted = one.information @ lens_terms(one.camera) + other.information @ lens_terms(other.camera)
    mean: Vector = np.asarray(np.linalg.lstsq(information, weighted, rcond=None)[0], np.float64)
    possible = np.allclose(believable(mean[None], fisheye)[0], mean, rtol=0.0, atol=SAME_LENS)
    if not possible or one.camera.fisheye != other.camera.fisheye:
        return one if _known(one.information) >= _known(other.information) else other
    return Lens(with_lens(one.camera, mean), information)


SAME_LENS = 1e-9  # tolerance of its terms; rounding may carry the mean of two lenses at a limit across it


def _known(information: SquareMatrix) -> float:
    """Joint information on a lens' terms: log of the volume reduction relative to terms known to about 1."""
    return float(np.linalg.slogdet(information + np.eye(len(information)))[1])
