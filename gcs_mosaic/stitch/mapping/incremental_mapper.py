"""Which island a frame belongs to: beside what is placed, with one that waits, or on its own for now."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from types import MappingProxyType

import numpy as np

from gcs_mosaic.stitch.bundle.schedule import Upkeep
from gcs_mosaic.stitch.camera.geometry import Pose
from gcs_mosaic.stitch.graph.candidates import Search
from gcs_mosaic.stitch.graph.observer import Observer
from gcs_mosaic.stitch.graph.placement import placement_of
from gcs_mosaic.stitch.graph.view_graph import NOWHERE, Bridge, Network
from gcs_mosaic.stitch.mapping.islands import Bridges
from gcs_mosaic.stitch.mapping.resection import Placing
from gcs_mosaic.stitch.registration.registration import Registration
from gcs_mosaic.stitch.transaction import EachWhole, attempt

WAITING_TRIES = 2  # waiting frames, or founders that nothing has joined, that a newly placed one is matched with
BRIDGE_TRIES = 3  # frames of other islands that a newly placed one is matched with

Pair = tuple[int, int]


class Assembly:
    """Puts frames of a network on islands, and islands together. Remembers nothing itself."""

    def __init__(
        self,
        network: Network,
        search: Search,
        placing: Placing,
        bridges: Bridges,
        upkeep: Upkeep,
        observer: Observer | None = None,
    ) -> None:
        self._network = network
        self._search = search
        self._placing = placing
        self._bridges = bridges
        self._upkeep = upkeep
        self._observer = observer

    def take_in(self, frame: int, compared: Mapping[int, Registration | None] = MappingProxyType({})) -> bool:
        """Place a frame of the network that is new, and all that finds its place because of it; False if it must wait.

        `compared`: what came of comparing it with some placed frames already.
        """
        placed = self._place_first(frame, compared)
        if not placed:
            self._network.waiting.add(frame)
        self._use_what_is_new(placed)
        return bool(placed)

    def retry_waiting(self) -> None:
        """Try every frame that waits once more, and again as long as any finds its place.

        One that raises counts as tried, and keeps no other from it; the first error is raised at the end.
        """
        self._network.waiting.forget_comparisons()
        with EachWhole(self._network, self._upkeep, otherwise="a frame that waits was not tried again") as each:
            while any(self._retry(frame, each) for frame in self._network.waiting):
                pass

    def connect_some(self, frames: int) -> bool:
        """In a pause: compare so many frames with those that look most like them and are not connected with them.

        False if there is nothing left to compare: every frame has been, since something new was known last. Two frames that
        raise count as compared, and keep no others from it; the first error is raised at the end.
        """
        network = self._network
        if not network.frames_to_ask and network.asked_when != self._what_is_known():
            network.asked_when = self._what_is_known()
            network.frames_to_ask = self._apart_from_most()
        asked, network.frames_to_ask = network.frames_to_ask[:frames], network.frames_to_ask[frames:]
        with EachWhole(network, self._upkeep, otherwise="frames that may be connected were not compared") as each:
            for frame in asked:
                self._compare_with_likeliest(frame, each)
        return bool(network.frames_to_ask) or network.asked_when != self._what_is_known()

    def _compare_with_likeliest(self, frame: int, each: EachWhole) -> None:
        count = self._bridges.tries_in_a_pause
        for other in each.tried(lambda: self._search.likeliest(frame, self._apart_from(frame), count)) or []:
            if self._is_worth_comparing(frame, other) and other in self._apart_from(frame):
                self._network.compared[_pair(frame, other)] = None
                self._place_and_use(partial(self._compare, frame, other), each)

    def _is_worth_comparing(self, frame: int, other: int) -> bool:
        """Whether they were never compared, or have much in common and lie elsewhere than when that led to nothing."""
        pair, compared = _pair(frame, other), self._network.compared
        return pair not in compared or compared[pair] not in (None, self._poses(pair))

    def _poses(self, pair: Pair) -> tuple[Pose | None, Pose | None]:
        return self._network.frames[pair[0]].pose, self._network.frames[pair[1]].pose

    def _what_is_known(self) -> tuple[int, int, int]:
        """Changes whenever a frame comes or is placed, or islands are joined."""
        network = self._network
        placed = int(np.count_nonzero(network.islands != NOWHERE))
        return len(network.frames), placed, sum(into is not None for into in network.merged_into)

    def _apart_from_most(self) -> list[int]:
        """Frames that wait, and those of all islands but the largest, the smallest first."""
        islands = sorted(self._network.frame_counts().items(), key=lambda island: (island[1], -island[0]))
        return [
            *self._network.waiting,
            *(frame for island, _ in islands[:-1] for frame in self._network.members(island).tolist()),
        ]

    def _apart_from(self, frame: int) -> list[int]:
        """Frames that are not connected with this one: of other islands, or waiting."""
        network = self._network
        placed = network.placed() if network.islands[frame] == NOWHERE else network.elsewhere(network.island_of(frame))
        return [*placed.tolist(), *(other for other in network.waiting if other != frame)]

    def _compare(self, frame: int, other: int) -> list[int]:
        """Two frames that may show one ground. Returns those that waited and are placed now."""
        first, second = sorted((frame, other), key=self._company)
        registration = self._search.register(first, second)
        if registration is None:
            return []
        placed, pair = self._connect(first, second, registration), _pair(frame, other)
        self._network.compared[pair] = self._poses(pair)
        return placed

    def _company(self, frame: int) -> int:
        """0 for a frame that waits, 1 for one alone on its island, 2 for all others."""
        island = self._network.islands[frame]
        return 0 if island == NOWHERE else min(self._network.count_members(island), 2)

    def _connect(self, first: int, second: int, registration: Registration) -> list[int]:
        """Join the islands of two frames that were registered, place the one that waits, or found an island with both.

        The first is in no larger company than the second. Returns those that waited and are placed now.
        """
        if self._company(second) == 0:
            return self._founded_together(first, second, registration)
        if self._company(first) == 0:
            return [first] if self._place_waiting(first, second, registration) else []
        if self._company(first) > 1 or not self._came_home(first, second, registration):
            self._joined_by(first, second, registration)
        return []

    def _place_and_use(self, place: Callable[[], list[int]], each: EachWhole) -> bool:
        """Whether this places any frames. What then raises with those that they give their place leaves them where they are."""
        placed = each.tried(place)
        if placed:
            each.tried(partial(self._use_what_is_new, placed))
        return bool(placed)

    # A frame finds its place

    def _place_first(self, frame: int, compared: Mapping[int, Registration | None]) -> list[int]:
        """The frame, if it is the first of all or can be placed; and another that it has founded an island with."""
        if not self._network.merged_into:
            self._found_island(frame)
            return [frame]
        links = self._search.first_links(frame, self._network.last_placed, compared)
        if any(self._place_beside(frame, other, registration) for other, registration in links):
            return [frame]
        return self._found_with_waiting(frame)

    def _found_island(self, frame: int) -> None:
        """The frame lies level and at its own resolution on a canvas of its own."""
        island, network = self._network.found_island(), self._network
        camera = network.camera_on(island, network.frames[frame].camera)
        self._settle(frame, Pose(*camera.centre), island)

    def _settle(self, frame: int, pose: Pose, island: int) -> None:
        self._network.put(frame, pose, island)
        self._network.last_placed = frame
        self._upkeep.grow(island)
        if self._observer:
            self._observer.placed(placement_of(self._network, frame))

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

    def _found_with_waiting(self, frame: int) -> list[int]:
        """Two frames that match nothing but each other found an island."""
        for other in self._search.likeliest(frame, list(self._network.waiting)):
            registration = self._search.register(frame, other)
            if registration is not None and (founded := self._founded_together(frame, other, registration)):
                return founded
        return []

    def _founded_together(self, frame: int, other: int, registration: Registration) -> list[int]:
        """Both frames, if they can be placed beside each other on an island of their own; none of them lies anywhere yet."""
        with attempt(self._network, self._upkeep) as trial:
            self._found_island(other)
            if self._place_beside(frame, other, registration):
                self._network.waiting.remove(frame)
                self._network.waiting.remove(other)
                trial.keep()
        return [other, frame] if trial.kept else []

    # What a newly placed frame makes possible

    def _use_what_is_new(self, placed: Iterable[int]) -> None:
        """Newly placed frames may give waiting ones their place, and so on, or connect their island with another."""
        new = deque(placed)
        while new:
            frame = new.popleft()
            new.extend(self._waiting_beside(frame))
            self._connect_islands(frame)

    def _waiting_beside(self, frame: int) -> Iterator[int]:
        """Frames that have waited and find their place beside a newly placed one, or whose turn it is."""
        waiting = self._network.waiting
        waiting.note_placed(frame)
        for other in self._search.likeliest(frame, list(waiting), WAITING_TRIES):
            yield from self._placed_waiting(other, [frame])
        turn = waiting.next_turn()
        if turn:
            other, new = turn
            yield from self._placed_waiting(
                other, self._search.likeliest(other, self._still_placed(new), WAITING_TRIES)
            )

    def _retry(self, frame: int, each: EachWhole) -> bool:
        if frame not in self._network.waiting:  # it has found its place by another's
            return False
        new = self._still_placed(self._network.waiting.take_new(frame))
        return self._place_and_use(lambda: list(self._placed_waiting(frame, self._search.likeliest(frame, new))), each)

    def _placed_waiting(self, frame: int, among: Iterable[int]) -> Iterator[int]:
        """A frame that waits, if it can be placed beside one of these placed ones."""
        for other in among:
            registration = self._search.register(frame, other)
            if registration is not None and self._place_waiting(frame, other, registration):
                yield frame
                return

    def _place_waiting(self, frame: int, other: int, registration: Registration) -> bool:
        """Place a frame that waits beside a placed one, unless the result is not to be believed."""
        placed = self._place_beside(frame, other, registration)
        if placed:
            self._network.waiting.remove(frame)
        return placed

    def _still_placed(self, frames: list[int]) -> list[int]:
        return [frame for frame in frames if self._network.frames[frame].pose is not None]

    # Islands find each other

    def _connect_islands(self, frame: int) -> None:
        """Look for this frame's ground on other islands; join two when the evidence suffices."""
        here = self._network.island_of(frame)
        compared = self._bring_home_lone_founders(frame, here) if self._network.count_members(here) > 1 else {}
        for other in self._search.likeliest(frame, self._network.elsewhere(here), BRIDGE_TRIES):
            registration = compared[other] if other in compared else self._search.register(frame, other)
            if registration is not None and self._joined_by(frame, other, registration):
                return

    def _joined_by(self, frame: int, other: int, registration: Registration) -> bool:
        """Whether two frames of different islands show that these are one; then they are from now on."""
        proof = self._bridges.add(Bridge(frame, other, registration))
        if not proof:
            return False
        stays, goes = self._bridges.join(proof)
        self._upkeep.forget(goes)
        self._upkeep.grow(stays, self._network.count_members(stays))  # all of it: its adjustment is due
        self._network.waiting.forget_comparisons()
        return True

    def _bring_home_lone_founders(self, frame: int, here: int) -> dict[int, Registration | None]:
        """A founder that nothing has joined is as good as waiting: it may find its place beside this frame.

        Returns what came of comparing the frame with each of those tried.
        """
        network, compared = self._network, dict[int, Registration | None]()
        alone = [island for island, count in network.frame_counts().items() if count == 1 and island != here]
        founders = [f for island in alone for f in network.members(island).tolist()]
        for founder in self._search.likeliest(frame, founders, WAITING_TRIES):
            registration = self._search.register(founder, frame)
            compared[founder] = registration and registration.turned()
            if registration is not None:
                self._came_home(founder, frame, registration)
        return compared

    def _came_home(self, founder: int, frame: int, registration: Registration) -> bool:
        """Whether a frame that is alone on its island can be placed beside one of another; then it is."""
        network = self._network
        lone, here = network.island_of(founder), network.island_of(frame)
        with attempt(network, self._upkeep) as trial:
            network.take_back(founder)
            if self._place_beside(founder, frame, registration):
                network.merge(lone, here)
                self._upkeep.forget(lone)
                trial.keep()
        return trial.kept


def _pair(frame: int, other: int) -> Pair:
    """Two frames, whichever is named first."""
    return min(frame, other), max(frame, other)
