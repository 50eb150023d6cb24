"""Incremental mapper: a frame joins placed frames or a waiting one, or waits."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cache, partial
from types import MappingProxyType

import numpy as np

from gcs_mosaic.stitch.bundle.schedule import Upkeep
from gcs_mosaic.stitch.camera.geometry import Pose
from gcs_mosaic.stitch.graph.candidates import Search
from gcs_mosaic.stitch.graph.observer import Observer
from gcs_mosaic.stitch.graph.placement import placement_of
from gcs_mosaic.stitch.graph.view_graph import NOWHERE, Bridge, ViewGraph
from gcs_mosaic.stitch.mapping.islands import Bridges
from gcs_mosaic.stitch.mapping.resection import Placing
from gcs_mosaic.stitch.mapping.second_look import Finer, Pair, SecondLook, SecondLookSettings, pair_of
from gcs_mosaic.stitch.registration.outcome import Registration
from gcs_mosaic.stitch.transaction import EachWhole, attempt

WAITING_TRIES = 2  # waiting frames, or lone founders, that a newly placed frame is matched with
BRIDGE_TRIES = 3  # frames of other islands that a newly placed one is matched with
OUTDONE = 8.0  # times the evidence of the link to a placed frame: with as much for a waiting one, a frame joins that
OUTDONE_TRIES = 1  # waiting frames that a frame is matched with for that

NO_SECOND_LOOK = SecondLookSettings(megapixels=0)


class Assembly:
    """Assigns frames of a graph to islands and merges islands. Stateless."""

    def __init__(
        self,
        graph: ViewGraph,
        search: Search,
        placing: Placing,
        bridges: Bridges,
        upkeep: Upkeep,
        observer: Observer | None = None,
        second_look: SecondLookSettings = NO_SECOND_LOOK,
        finer: Finer | None = None,
    ) -> None:
        self._graph = graph
        self._search = search
        self._placing = placing
        self._bridges = bridges
        self._upkeep = upkeep
        self._observer = observer
        self._second_look = SecondLook(graph, search, second_look, self._are_apart, finer)

    def take_in(self, frame: int, compared: Mapping[int, Registration | None] = MappingProxyType({})) -> bool:
        """Place a new frame of the graph and all frames that become placeable by it; False if it must wait.

        `compared`: results of comparisons already made with placed frames.
        """
        placed = self._place_first(frame, compared)
        if not placed:
            self._graph.waiting.add(frame)
        self._use_what_is_new(placed)
        return bool(placed)

    def retry_waiting(self) -> None:
        """Retry every waiting frame, and repeat as long as any is placed.

        One that raises counts as tried and does not stop the others; the first error is raised at the end.
        """
        self._graph.waiting.forget_comparisons()
        with EachWhole(self._graph, self._upkeep, otherwise="a frame that waits was not tried again") as each:
            while any(self._retry(frame, each) for frame in self._graph.waiting):
                pass

    def connect_some(self, frames: int) -> bool:
        """When idle: compare this many frames with the most similar ones they are not connected with; then look a second time at
        frames that would be lost.

        False once every frame has been compared with the present state of knowledge. Two frames whose comparison raises count
        as compared and do not stop the others; the first error is raised at the end.
        """
        graph = self._graph
        if not graph.frames_to_ask and graph.asked_when != self._what_is_known():
            graph.asked_when = self._what_is_known()
            graph.frames_to_ask = self._apart_from_most()
        asked, graph.frames_to_ask = graph.frames_to_ask[:frames], graph.frames_to_ask[frames:]
        with EachWhole(graph, self._upkeep, otherwise="frames that may be connected were not compared") as each:
            for frame in asked:
                self._compare_with_likeliest(frame, each)
        return bool(graph.frames_to_ask) or graph.asked_when != self._what_is_known() or self._looked_again()

    def _looked_again(self) -> bool:
        """Make a step of a second look; False if there is none to make."""
        look = self._second_look
        pair = look.next_pair(self._what_is_known())
        if pair is None:
            return False
        with EachWhole(self._graph, self._upkeep, otherwise="frames were not looked at a second time") as each:
            if each.tried(lambda: look.is_ready(pair)):
                self._graph.looked_again.add(pair)
                self._place_and_use(partial(self._compare, *pair, look.register), each)
        return True

    def connect(self, pairs: Iterable[Pair]) -> bool:
        """Compare these pairs of frames, where they are not connected; as `connect_some`. Whether any was connected."""
        before = self._what_is_known()
        with EachWhole(self._graph, self._upkeep, otherwise="frames that may be connected were not compared") as each:
            for frame, other in pairs:
                self._compare_if_apart(frame, other, each)
        return self._what_is_known() != before

    def _compare_with_likeliest(self, frame: int, each: EachWhole) -> None:
        count = self._bridges.tries_in_a_pause
        for other in each.tried(lambda: self._search.likeliest(frame, self._apart_from(frame), count)) or []:
            self._compare_if_apart(frame, other, each)

    def _compare_if_apart(self, frame: int, other: int, each: EachWhole) -> None:
        if self._are_apart(frame, other) and self._is_worth_comparing(frame, other):
            self._graph.compared[pair_of(frame, other)] = None
            self._place_and_use(partial(self._compare, frame, other, self._search.register), each)

    def _are_apart(self, frame: int, other: int) -> bool:
        """Whether two frames are not connected: on two islands, or one of them waiting."""
        here, there = (self._graph.islands[one] for one in (frame, other))
        return other in self._graph.waiting if there == NOWHERE else bool(here != there)

    def _is_worth_comparing(self, frame: int, other: int) -> bool:
        """Whether they were never compared, or have much in common and have moved since that failed."""
        pair, compared = pair_of(frame, other), self._graph.compared
        return pair not in compared or compared[pair] not in (None, self._poses(pair))

    def _poses(self, pair: Pair) -> tuple[Pose | None, Pose | None]:
        return self._graph.frames[pair[0]].pose, self._graph.frames[pair[1]].pose

    def _what_is_known(self) -> tuple[int, int, int]:
        """Changes whenever a frame arrives or is placed, or islands are merged."""
        graph = self._graph
        placed = int(np.count_nonzero(graph.islands != NOWHERE))
        return len(graph.frames), placed, sum(into is not None for into in graph.merged_into)

    def _apart_from_most(self) -> list[int]:
        """Waiting frames, and those of all islands but the largest, smallest island first."""
        islands = sorted(self._graph.frame_counts().items(), key=lambda island: (island[1], -island[0]))
        return [
            *self._graph.waiting,
            *(frame for island, _ in islands[:-1] for frame in self._graph.members(island).tolist()),
        ]

    def _apart_from(self, frame: int) -> list[int]:
        """Frames not connected with this one: on other islands, or waiting."""
        graph = self._graph
        placed = graph.placed() if graph.islands[frame] == NOWHERE else graph.elsewhere(graph.island_of(frame))
        return [*placed.tolist(), *(other for other in graph.waiting if other != frame)]

    def _compare(self, frame: int, other: int, register: Callable[[int, int], Registration | None]) -> list[int]:
        """Compare two frames that may overlap. Returns waiting frames that are placed now."""
        first, second = sorted((frame, other), key=self._company)
        registration = register(first, second)
        if registration is None:
            return []
        placed, pair = self._connect(first, second, registration), pair_of(frame, other)
        self._graph.compared[pair] = self._poses(pair)
        return placed

    def _company(self, frame: int) -> int:
        """0 for a waiting frame, 1 for one alone on its island, 2 for all others."""
        island = self._graph.islands[frame]
        return 0 if island == NOWHERE else min(self._graph.count_members(island), 2)

    def _connect(self, first: int, second: int, registration: Registration) -> list[int]:
        """Merge the islands of two registered frames, place the waiting one, or found an island with both.

        The first has no more company than the second. Returns waiting frames that are placed now.
        """
        if self._company(second) == 0:
            return self._founded_together(first, second, registration)
        if self._company(first) == 0:
            return [first] if self._place_waiting(first, second, registration) else []
        if self._company(first) > 1 or not self._came_home(first, second, registration):
            self._joined_by(first, second, registration)
        return []

    def _place_and_use(self, place: Callable[[], list[int]], each: EachWhole) -> bool:
        """Whether this places any frames. An error in what follows from them does not undo their placement."""
        placed = each.tried(place)
        if placed:
            each.tried(partial(self._use_what_is_new, placed))
        return bool(placed)

    # Placing a frame

    def _place_first(self, frame: int, compared: Mapping[int, Registration | None]) -> list[int]:
        """The frame, if it is the first or can be placed; and another one with which it founded an island."""
        if not self._graph.merged_into:
            self._found_island(frame)
            return [frame]
        links = self._search.first_links(frame, self._graph.last_placed, compared)
        among_waiting = cache(partial(self._evidence_among_waiting, frame))
        for other, registration in links:
            if among_waiting() > OUTDONE * registration.evidence:  # a look-alike: both find the right island together
                break
            if self._place_beside(frame, other, registration):
                return [frame]
        return self._found_with_waiting(frame)

    def _evidence_among_waiting(self, frame: int) -> float:
        """The most that a frame shows of the same as a waiting one."""
        likeliest = self._search.likeliest(frame, list(self._graph.waiting), OUTDONE_TRIES)
        found = [self._search.register(frame, other) for other in likeliest]
        return max((one.evidence for one in found if one is not None), default=0.0)

    def _found_island(self, frame: int) -> None:
        """The frame is placed level and at its own resolution on a new canvas."""
        island, graph = self._graph.found_island(), self._graph
        camera = graph.camera_on(island, graph.frames[frame].camera)
        self._settle(frame, Pose(*camera.centre), island)

    def _settle(self, frame: int, pose: Pose, island: int) -> None:
        self._graph.put(frame, pose, island)
        self._graph.placed_before, self._graph.last_placed = self._graph.last_placed, frame
        self._upkeep.grow(island)
        if self._observer:
            self._observer.placed(placement_of(self._graph, frame))

    def _place_beside(self, frame: int, other: int, registration: Registration) -> bool:
        """Place a frame from its first link; False (and no change) if its pose is rejected."""
        found = self._placing.pose_beside(frame, other, registration)
        if isinstance(found, Pose):
            self._settle(frame, found, self._graph.island_of(other))
            self._placing.note_relief(frame)
        elif self._observer:
            name, beside = (self._graph.frames[f].name for f in (frame, other))
            self._observer.disbelieved(name, beside, found.reason)
        return isinstance(found, Pose)

    def _found_with_waiting(self, frame: int) -> list[int]:
        """Two frames that match nothing but each other found an island."""
        for other in self._search.likeliest(frame, list(self._graph.waiting)):
            registration = self._search.register(frame, other)
            if registration is not None and (founded := self._founded_together(frame, other, registration)):
                return founded
        return []

    def _founded_together(self, frame: int, other: int, registration: Registration) -> list[int]:
        """Both frames, if they can be placed together on a new island; neither is placed yet."""
        with attempt(self._graph, self._upkeep) as trial:
            self._found_island(other)
            if self._place_beside(frame, other, registration):
                self._graph.waiting.remove(frame)
                self._graph.waiting.remove(other)
                trial.keep()
        return [other, frame] if trial.kept else []

    # Consequences of a new placement

    def _use_what_is_new(self, placed: Iterable[int]) -> None:
        """Newly placed frames may make waiting ones placeable, and so on, or connect their island with another."""
        new = deque(placed)
        while new:
            frame = new.popleft()
            new.extend(self._waiting_beside(frame))
            self._connect_islands(frame)

    def _waiting_beside(self, frame: int) -> Iterator[int]:
        """Waiting frames placed beside a newly placed one, or because their turn has come."""
        waiting = self._graph.waiting
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
        if frame not in self._graph.waiting:  # placed meanwhile through another frame
            return False
        new = self._still_placed(self._graph.waiting.take_new(frame))
        return self._place_and_use(lambda: list(self._placed_waiting(frame, self._search.likeliest(frame, new))), each)

    def _placed_waiting(self, frame: int, among: Iterable[int]) -> Iterator[int]:
        """A waiting frame, if it can be placed beside one of these placed ones."""
        for other in among:
            registration = self._search.register(frame, other)
            if registration is not None and self._place_waiting(frame, other, registration):
                yield frame
                return

    def _place_waiting(self, frame: int, other: int, registration: Registration) -> bool:
        """Place a waiting frame beside a placed one, unless its pose is rejected."""
        placed = self._place_beside(frame, other, registration)
        if placed:
            self._graph.waiting.remove(frame)
        return placed

    def _still_placed(self, frames: list[int]) -> list[int]:
        return [frame for frame in frames if self._graph.frames[frame].pose is not None]

    # Merging islands

    def _connect_islands(self, frame: int) -> None:
        """Search other islands for this frame's ground; merge two if the evidence suffices."""
        here = self._graph.island_of(frame)
        compared = self._bring_home_lone_founders(frame, here) if self._graph.count_members(here) > 1 else {}
        for other in self._search.likeliest(frame, self._graph.elsewhere(here), BRIDGE_TRIES):
            registration = compared[other] if other in compared else self._search.register(frame, other)
            if registration is not None and self._joined_by(frame, other, registration):
                return

    def _joined_by(self, frame: int, other: int, registration: Registration) -> bool:
        """Add a bridge between two islands; True if they were merged by it."""
        proof = self._bridges.add(Bridge(frame, other, registration))
        if not proof:
            return False
        stays, goes = self._bridges.join(proof)
        self._upkeep.forget(goes)
        self._upkeep.grow(stays, self._graph.count_members(stays))  # all of it: its adjustment is due
        self._graph.waiting.forget_comparisons()
        return True

    def _bring_home_lone_founders(self, frame: int, here: int) -> dict[int, Registration | None]:
        """Treat lone founders like waiting frames: each may be placed beside this frame.

        Returns the comparisons of the frame with each of those tried.
        """
        graph, compared = self._graph, dict[int, Registration | None]()
        alone = [island for island, count in graph.frame_counts().items() if count == 1 and island != here]
        founders = [f for island in alone for f in graph.members(island).tolist()]
        for founder in self._search.likeliest(frame, founders, WAITING_TRIES):
            registration = self._search.register(founder, frame)
            compared[founder] = registration and registration.turned()
            if registration is not None:
                self._came_home(founder, frame, registration)
        return compared

    def _came_home(self, founder: int, frame: int, registration: Registration) -> bool:
        """Move a frame that is alone on its island beside a frame of another; True if that succeeded."""
        graph = self._graph
        lone, here = graph.island_of(founder), graph.island_of(frame)
        with attempt(graph, self._upkeep) as trial:
            graph.take_back(founder)
            if self._place_beside(founder, frame, registration):
                graph.merge(lone, here)
                self._upkeep.forget(lone)
                trial.keep()
        return trial.kept
