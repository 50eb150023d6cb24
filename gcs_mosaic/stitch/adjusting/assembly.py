"""Which island a frame belongs to: beside what is placed, with one that waits, or on its own for now."""

from __future__ import annotations

from collections.abc import Iterable

from gcs_mosaic.stitch.adjusting.upkeep import Upkeep
from gcs_mosaic.stitch.geometry import Pose
from gcs_mosaic.stitch.islands import Bridge, Bridges, Island
from gcs_mosaic.stitch.matching.registration import Registration
from gcs_mosaic.stitch.network import Network
from gcs_mosaic.stitch.observer import Observer
from gcs_mosaic.stitch.placement import placement_of
from gcs_mosaic.stitch.placing import Placing
from gcs_mosaic.stitch.search import Search
from gcs_mosaic.stitch.waiting import WaitingFrames

WAITING_TRIES = 2  # waiting frames, or founders that nothing has joined, that a newly placed one is matched with
BRIDGE_TRIES = 3  # frames of other islands that a newly placed one is matched with


class Assembly:
    """Puts frames on islands, and islands together. `islands`: all there have ever been, by number."""

    def __init__(
        self,
        network: Network,
        search: Search,
        placing: Placing,
        bridges: Bridges,
        upkeep: Upkeep,
        observer: Observer | None = None,
    ) -> None:
        self.islands: list[Island] = []
        self.waiting = WaitingFrames()
        self._network = network
        self._search = search
        self._placing = placing
        self._bridges = bridges
        self._upkeep = upkeep
        self._observer = observer
        self._last_placed = 0

    def take_in(self, frame: int) -> bool:
        """Place a frame of the network that is new, and all that finds its place because of it; False if it must wait."""
        if not self.islands:
            self._found_island(frame)
        elif not (self._place_among_placed(frame) or self._found_with_waiting(frame)):
            self.waiting.add(frame)
            return False
        self._use_what_is_new(frame)
        return True

    def retry_waiting(self) -> None:
        """Try every frame that waits once more, and again as long as any finds its place."""
        self.waiting.forget_comparisons()
        while any(self._retry(frame) for frame in self.waiting):
            pass

    def _found_island(self, frame: int) -> int:
        """The frame lies level and at its own resolution on a canvas of its own."""
        self.islands.append(Island(len(self.islands)))
        self._settle(frame, Pose(*self._network.camera_of(frame).centre), self.islands[-1].number)
        return self.islands[-1].number

    def _settle(self, frame: int, pose: Pose, island: int) -> None:
        self._network.put(frame, pose, island)
        self._last_placed = frame
        self._upkeep.grow(island)
        if self._observer:
            self._observer.placed(placement_of(self._network, frame))

    def _place_among_placed(self, frame: int) -> bool:
        links = self._search.first_links(frame, self._last_placed)
        return any(self._place_beside(frame, other, registration) for other, registration in links)

    def _place_beside(self, frame: int, other: int, registration: Registration) -> bool:
        """Place a frame from its first link; False (and nothing kept) if the result is not to be believed."""
        found = self._placing.pose_beside(frame, other, registration)
        if isinstance(found, Pose):
            self._settle(frame, found, self._network.island_of(other))
            self._placing.note_relief(frame)
        elif self._observer:
            name, beside = (self._network.frames[f].name for f in (frame, other))
            self._observer.disbelieved(name, beside, found.reason)
        return isinstance(found, Pose)

    def _found_with_waiting(self, frame: int) -> bool:
        """Two frames that match nothing but each other found an island."""
        for other in self._search.likeliest(frame, list(self.waiting)):
            registration = self._search.register(frame, other)
            if registration is None:
                continue
            last, island = self._last_placed, self._found_island(other)
            if self._place_beside(frame, other, registration):
                self.waiting.remove(other)
                self._use_what_is_new(other)
                return True
            self.islands.pop()
            self._upkeep.forget(island)
            self._network.take_back(other)
            self._last_placed = last
        return False

    def _use_what_is_new(self, frame: int) -> None:
        """A newly placed frame may give waiting ones their place, or connect its island with another."""
        self.waiting.note_placed(frame)
        for other in self._search.likeliest(frame, list(self.waiting), WAITING_TRIES):
            self._place_waiting(other, [frame])
        turn = self.waiting.next_turn()
        if turn:
            other, new = turn
            self._place_waiting(other, self._search.likeliest(other, self._still_placed(new), WAITING_TRIES))
        self._connect_islands(frame)

    def _retry(self, frame: int) -> bool:
        new = self._still_placed(self.waiting.take_new(frame))
        return self._place_waiting(frame, self._search.likeliest(frame, new))

    def _place_waiting(self, frame: int, among: Iterable[int]) -> bool:
        """Place a frame that waits beside one of these placed ones; what that makes possible follows."""
        for other in among:
            if frame not in self.waiting:  # it has found its place by another's
                return False
            registration = self._search.register(frame, other)
            if registration is not None and self._place_beside(frame, other, registration):
                self.waiting.remove(frame)
                self._use_what_is_new(frame)
                return True
        return False

    def _still_placed(self, frames: list[int]) -> list[int]:
        return [frame for frame in frames if self._network.frames[frame].pose is not None]

    def _connect_islands(self, frame: int) -> None:
        """Look for this frame's ground on other islands; join two when the evidence suffices."""
        here = self._network.island_of(frame)
        if self._network.count_members(here) > 1:
            self._bring_home_lone_founders(frame, here)
        for other in self._search.likeliest(frame, self._network.elsewhere(here), BRIDGE_TRIES):
            registration = self._search.register(frame, other)
            proof = self._bridges.add(Bridge(frame, other, registration)) if registration else []
            if proof:
                stays, goes = self._bridges.join(proof)
                self.islands[goes].merged_into = stays
                self._upkeep.grow(stays, self._upkeep.forget(goes) + self._network.count_members(stays))
                self.waiting.forget_comparisons()
                return

    def _bring_home_lone_founders(self, frame: int, here: int) -> None:
        """A founder that nothing has joined is as good as waiting: it may find its place beside this frame."""
        counts = self._network.frame_counts()
        founders = [
            f for island, n in counts.items() if n == 1 and island != here for f in self._network.members(island)
        ]
        for founder in self._search.likeliest(frame, founders, WAITING_TRIES):
            registration = self._search.register(founder, frame)
            if registration is None:
                continue
            pose, lone = self._network.pose_of(founder), self._network.island_of(founder)
            self._network.take_back(founder)
            if self._place_beside(founder, frame, registration):
                self.islands[lone].merged_into = here
                self._upkeep.forget(lone)
            else:
                self._network.put(founder, pose, lone)
