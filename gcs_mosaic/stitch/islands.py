"""Islands: parts of the map that are not (yet) connected, and the evidence that joins two of them.

A wrong join is worse than none, so one pair of frames never decides: two pairs that share no frame must put one island
at the same place on the other.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.stitch.geometry import canvas_from_pixels, moved_by_similarity, similarity_between
from gcs_mosaic.stitch.network import Network
from gcs_mosaic.stitch.registration import Registration

Array = NDArray[np.float64]
Similarity = tuple[float, float, Array]  # scale, angle in radians, shift

AGREEMENT = 0.1  # of a footprint's diagonal: how far two bridges may put the same ground apart


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

    def __init__(self, network: Network) -> None:
        self._network = network
        self._bridges: list[Bridge] = []

    def add(self, newest: Bridge) -> list[Bridge]:
        """Keep a bridge; returns it and all that agree with it if together they prove the join, else nothing."""
        agreeing = [bridge for bridge in self._between_the_same(newest) if self._agree(bridge, newest)]
        self._bridges.append(newest)
        return [newest, *agreeing] if agreeing else []

    def join(self, bridges: list[Bridge]) -> tuple[int, int]:
        """Move the smaller island onto the larger one, where the bridges say. Returns (island that stays, that goes)."""
        network = self._network
        sides = [network.island_of(bridges[0].frame_a), network.island_of(bridges[0].frame_b)]
        stays, goes = sorted(sides, key=lambda island: (-len(network.members(island)), island))
        stays_from_goes = self._similarity([self._from_side(bridge, stays) for bridge in bridges])
        for frame in network.members(goes).tolist():
            network.put(frame, moved_by_similarity(network.pose_of(frame), *stays_from_goes), stays)
            network.frames[frame].held = None
        for bridge in bridges:
            network.link(bridge.frame_a, bridge.frame_b, bridge.registration)
        self._bridges = [b for b in self._bridges if network.island_of(b.frame_a) != network.island_of(b.frame_b)]
        return stays, goes

    def _between_the_same(self, bridge: Bridge) -> list[Bridge]:
        """Earlier bridges between the two islands of this one, with the same side as a."""
        here, there = self._network.island_of(bridge.frame_a), self._network.island_of(bridge.frame_b)
        return [
            self._from_side(earlier, here)
            for earlier in self._bridges
            if {self._network.island_of(earlier.frame_a), self._network.island_of(earlier.frame_b)} == {here, there}
        ]

    def _from_side(self, bridge: Bridge, island: int) -> Bridge:
        return bridge if self._network.island_of(bridge.frame_a) == island else bridge.turned()

    def _agree(self, first: Bridge, second: Bridge) -> bool:
        """Whether two bridges share no frame and put island b at the same place of island a."""
        if first.frame_a == second.frame_a or first.frame_b == second.frame_b:
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
