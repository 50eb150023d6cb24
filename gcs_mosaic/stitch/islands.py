"""Islands: parts of the map that are not (yet) connected, and the evidence that joins two of them.

A wrong join is worse than none. A pair of frames across the water (a bridge) says where one island lies on the other; chance
alone does not make one (evidence.py), but something that looks alike elsewhere does, whatever the number of its matches. So
a bridge is a hypothesis: it is tested where the islands should overlap, and what is found there must agree, on different
ground and between different frames, until the evidence suffices.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.stitch.geometry import canvas_from_pixels, moved_by_similarity, similarity_between
from gcs_mosaic.stitch.matching.evidence import SAMPLE
from gcs_mosaic.stitch.matching.registration import Registration
from gcs_mosaic.stitch.matching.witnesses import MAJORITY, confirmed_share
from gcs_mosaic.stitch.neighbours import boxes_meet, boxes_shared
from gcs_mosaic.stitch.network import Network, box_of, centres
from gcs_mosaic.stitch.search import Search

Array = NDArray[np.float64]
Similarity = tuple[float, float, Array]  # scale, angle in radians, shift

AGREEMENT = 0.1  # of a footprint's diagonal: how far two bridges may put the same ground apart
# -log10 of the chance that two wrong bridges agree so: 0.007 in place (3 x 3 footprints), 0.06 in heading (0.2 radians
# either way), 0.1 in scale (20 % of a factor of 5 either way).
LOG_AGREEMENT = 4.0
# Most that one bridge counts for, in decades: none of 1,900 registered pairs of the recorded flights was wrong, but over
# halls of one make one unrelated pair in five is registered.
LOG_BRIDGE = 2.0
# Of a footprint's diagonal: nearer than this, the matches of two bridges may lie on one and the same thing.
APART = 0.25
WITNESSES = 3  # frames of the smaller island for which the overlap is looked into
PAIRS_PER_WITNESS = 6  # frames of the larger one that each of them is matched with


@dataclass(frozen=True, slots=True, kw_only=True)
class IslandSettings:
    """When islands are joined."""

    # -log10 of wrong agreements expected: two bridges that agree give 8, one whatever its matches 2
    least_evidence: float = 6.0


@dataclass(slots=True)
class Island:
    number: int
    merged_into: int | None = None


@dataclass(frozen=True, slots=True)
class Bridge:
    """Two frames of different islands that were registered with each other."""

    frame_a: int
    frame_b: int
    registration: Registration  # of frame a with frame b

    def turned(self) -> Bridge:
        """The same bridge, seen from the other side."""
        return Bridge(self.frame_b, self.frame_a, self.registration.turned())


class Bridges:
    """Keeps what connects islands until it suffices to join them."""

    def __init__(self, network: Network, search: Search, settings: IslandSettings) -> None:
        self._network = network
        self._search = search
        self._settings = settings
        self._bridges: list[Bridge] = []

    def add(self, newest: Bridge) -> list[Bridge]:
        """Keep a bridge; returns all that agree with it, the larger island's side first, if they prove the join."""
        if not self._agree(newest, newest):
            return []  # its own matches fit no similarity: the frames lie awry on their islands
        self._bridges.append(newest)
        sides = [self._network.island_of(newest.frame_a), self._network.island_of(newest.frame_b)]
        stays, goes = sorted(sides, key=lambda island: (-len(self._network.members(island)), island))
        newest = self._from_side(newest, stays)
        known = [bridge for bridge in self._between(stays, goes) if self._agree(bridge, newest)]
        looked_for, share = self._look_into_overlap(stays, goes, known)
        agreeing = [*known, *(bridge for bridge in looked_for if self._agree(bridge, newest))]
        proven = share > MAJORITY and self._evidence(agreeing) >= self._settings.least_evidence
        return agreeing if proven else []

    def join(self, bridges: list[Bridge]) -> tuple[int, int]:
        """Move the smaller island onto the larger one, where the bridges say. Returns (island that stays, that goes)."""
        network = self._network
        stays, goes = network.island_of(bridges[0].frame_a), network.island_of(bridges[0].frame_b)
        stays_from_goes = self._similarity(bridges)
        for frame in network.members(goes).tolist():
            network.put(frame, moved_by_similarity(network.pose_of(frame), *stays_from_goes), stays)
            network.frames[frame].held = None
        for bridge in bridges:
            network.link(bridge.frame_a, bridge.frame_b, bridge.registration)
        self._bridges = [b for b in self._bridges if network.island_of(b.frame_a) != network.island_of(b.frame_b)]
        return stays, goes

    def _between(self, stays: int, goes: int) -> list[Bridge]:
        """All bridges between two islands, the first island's side as a."""
        return [
            self._from_side(bridge, stays)
            for bridge in self._bridges
            if {self._network.island_of(bridge.frame_a), self._network.island_of(bridge.frame_b)} == {stays, goes}
        ]

    def _from_side(self, bridge: Bridge, island: int) -> Bridge:
        return bridge if self._network.island_of(bridge.frame_a) == island else bridge.turned()

    def _look_into_overlap(self, stays: int, goes: int, known: list[Bridge]) -> tuple[list[Bridge], float]:
        """Match frames that should overlap if the known bridges are right.

        Returns what is found, and the share of the expected ground that is confirmed, of the worst witness.
        """
        network, stays_from_goes = self._network, self._similarity(known)
        found: list[Bridge] = []
        shares: list[float] = []
        for witness in self._witnesses(stays, goes, stays_from_goes, known):
            pose = moved_by_similarity(network.pose_of(witness), *stays_from_goes)
            links = dict(islice(self._search.neighbour_links(witness, pose, stays), PAIRS_PER_WITNESS))
            links |= {bridge.frame_a: bridge.registration.turned() for bridge in known if bridge.frame_b == witness}
            matched = {other: link for other, link in links.items() if link is not None}
            shares.append(confirmed_share(network, witness, pose, list(links), [m.pixels_a for m in matched.values()]))
            here = {bridge.frame_a for bridge in known if bridge.frame_b == witness}
            found += [Bridge(witness, other, link).turned() for other, link in matched.items() if other not in here]
        return found, min(shares)

    def _witnesses(self, stays: int, goes: int, stays_from_goes: Similarity, known: list[Bridge]) -> list[int]:
        """The newest bridge's frame, and those next to it that should see much of the other island.

        Farther ones would tell as well, but an island that is not joined yet may be bent.
        """
        network, members, newest = self._network, self._network.members(goes).tolist(), known[-1].frame_b
        moved = {f: moved_by_similarity(network.pose_of(f), *stays_from_goes) for f in members}
        boxes = {f: box_of(pose, network.camera_of(f)) for f, pose in moved.items()}
        others = network.boxes[network.members(stays)]
        shared = {f: boxes_shared(box, others[boxes_meet(box, others)]).max(initial=0.0) for f, box in boxes.items()}
        inside = [f for f, share in shared.items() if share > MAJORITY and f != newest]
        away = {f: float(np.linalg.norm(centres(boxes[f][None]) - centres(boxes[newest][None]))) for f in inside}
        return [newest, *sorted(inside, key=away.__getitem__)[: WITNESSES - 1]]

    def _evidence(self, bridges: list[Bridge]) -> float:
        """-log10 of the chance that these bridges are wrong and yet agree, by the independent ones among them."""
        independent = max((self._independent_of(first, bridges) for first in bridges), key=len)
        of_each = sum(min(bridge.registration.evidence, LOG_BRIDGE) for bridge in independent)
        return of_each + LOG_AGREEMENT * (len(independent) - 1)

    def _independent_of(self, first: Bridge, bridges: list[Bridge]) -> list[Bridge]:
        """The bridge and as many others as are found, strongest first, that are independent of it and of each other."""
        chosen = [first]
        for bridge in sorted(bridges, key=lambda b: -b.registration.evidence):
            if all(self._are_independent(bridge, other) for other in chosen):
                chosen.append(bridge)
        return chosen

    def _are_independent(self, one: Bridge, other: Bridge) -> bool:
        """Whether two bridges share no frame, and their matches lie on different ground."""
        if one.frame_a == other.frame_a or one.frame_b == other.frame_b:
            return False
        middles = [np.median(self._places(bridge)[0], axis=0) for bridge in (one, other)]
        return bool(np.linalg.norm(middles[0] - middles[1]) > APART * self._diagonal(one.frame_a))

    def _agree(self, first: Bridge, second: Bridge) -> bool:
        """Whether two bridges put island b at the same place of island a; what sees no ground agrees with nothing."""
        if min(len(self._places(bridge)[0]) for bridge in (first, second)) < SAMPLE:
            return False
        return all(
            self._misfit(self._similarity([bridge]), other) < AGREEMENT * self._diagonal(bridge.frame_a)
            for bridge, other in ((first, second), (second, first))
        )

    def _misfit(self, a_from_b: Similarity, bridge: Bridge) -> float:
        """Median distance by which a similarity misses the matches of another bridge, canvas units of island a."""
        scale, angle, shift = a_from_b
        c, s = np.cos(angle), np.sin(angle)
        places_a, places_b = self._places(bridge)
        moved = scale * places_b @ np.array([[c, s], [-s, c]]) + shift
        return float(np.median(np.linalg.norm(moved - places_a, axis=1)))

    def _similarity(self, bridges: list[Bridge]) -> Similarity:
        """Island a from island b, as these bridges show it together."""
        places = [self._places(bridge) for bridge in bridges]
        return similarity_between(np.concatenate([b for _, b in places]), np.concatenate([a for a, _ in places]))

    def _places(self, bridge: Bridge) -> tuple[Array, Array]:
        """Where the matches (m, 2) lie on either island, at the poses of now."""
        network, r = self._network, bridge.registration
        places_a, places_b = (
            canvas_from_pixels(network.pose_of(frame), network.camera_of(frame), pixels)
            for frame, pixels in ((bridge.frame_a, r.pixels_a), (bridge.frame_b, r.pixels_b))
        )
        seen = np.isfinite(places_a).all(axis=1) & np.isfinite(places_b).all(axis=1)
        return places_a[seen], places_b[seen]

    def _diagonal(self, frame: int) -> float:
        box = self._network.boxes[frame]
        return float(np.linalg.norm(box[2:] - box[:2]))
