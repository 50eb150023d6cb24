"""Processing order of waiting frames. A frame is its number in the order of capture: 0, 1, 2, ..."""

from __future__ import annotations

import math
from bisect import bisect_right, insort
from collections.abc import Collection
from typing import Protocol

Aircraft = int | None
AHEAD = 2  # decoded frames in memory besides the current one: 36 MB each at 12 MP
CORES_EACH = 2  # one prepares a frame, another places and paints the one before


def prepared_at_once(cores: int) -> int:
    """How many frames so many cores can prepare at a time, at most AHEAD, beside those that are placed."""
    return min(AHEAD, max(1, cores // CORES_EACH))


class Turns(Protocol):
    """Waiting frames and their processing order."""

    def add(self, frame: int, aircraft: Aircraft = None) -> None:
        """A frame has arrived; `aircraft`: which took it, where several are told apart."""

    def next(self, begun: Collection[int]) -> int | None:
        """The next frame among those being prepared; None while no frame that may be next is being prepared."""

    def remove(self, frame: int) -> None:
        """Remove a frame from the queue."""

    def soon(self) -> list[int]:
        """The frames, at most AHEAD, that come next if nothing new arrives, in order."""

    def processed(self, frame: int, on_map: Collection[int], *, waits: bool) -> None:
        """Report a frame's outcome: the frames placed with it, or whether it has no match so far."""


class AsTheyCame:
    """Oldest first: the same frames give the same map on any machine."""

    def __init__(self) -> None:
        self._waiting: list[int] = []

    def add(self, frame: int, aircraft: Aircraft = None) -> None:
        insort(self._waiting, frame)

    def next(self, begun: Collection[int]) -> int | None:
        return self._waiting[0] if self._waiting and self._waiting[0] in begun else None

    def remove(self, frame: int) -> None:
        self._waiting.remove(frame)

    def soon(self) -> list[int]:
        return self._waiting[:AHEAD]

    def processed(self, frame: int, on_map: Collection[int], *, waits: bool) -> None:
        return


class NewestFirst:
    """Newest first, so that the map shows where the aircraft is now, however many frames wait.

    Skipped frames are filled in when nothing newer waits: from the newest back, each next to one already on the map. The
    front is the newest frame on the map. If a frame ahead of it has no overlap there, one half as far ahead is next, and so
    on until one is placed, often bringing others with it. If not even the frame right after the front matches, the flight
    itself has a gap, and the frame after the gap becomes the front.
    """

    def __init__(self) -> None:
        self._waiting: list[int] = []  # oldest first
        self._front = -1
        self._reach = math.inf  # how many frames ahead of the front the next one may be

    def add(self, frame: int, aircraft: Aircraft = None) -> None:
        insort(self._waiting, frame)

    def next(self, begun: Collection[int]) -> int | None:
        among = self._whose_turn()
        return max((frame for frame in begun if among and among[0] <= frame <= among[-1]), default=None)

    def remove(self, frame: int) -> None:
        self._waiting.remove(frame)

    def soon(self) -> list[int]:
        """While several new frames wait, only the newest: the machine is busy enough."""
        among = self._whose_turn()
        if len(self._ahead()) > 1:
            return among[-1:]
        behind = self._waiting[: len(self._waiting) - len(self._ahead())]
        return list(dict.fromkeys([*among[-1:], *behind[: -AHEAD - 1 : -1]]))[:AHEAD]

    def processed(self, frame: int, on_map: Collection[int], *, waits: bool) -> None:
        if waits and frame > self._front:
            self._come_nearer(frame)
        if max(on_map, default=-1) > self._front:
            self._front, self._reach = max(on_map), math.inf

    def _come_nearer(self, frame: int) -> None:
        if bisect_right(self._waiting, frame) > bisect_right(self._waiting, self._front):
            self._reach = max(1, (frame - self._front) // 2)
        else:
            self._front, self._reach = frame, math.inf

    @property
    def has_new(self) -> bool:
        """Whether a frame waits that is newer than the newest on the map."""
        return bool(self._ahead())

    def is_new(self, frame: int) -> bool:
        """Whether it is newer than the newest on the map."""
        return frame > self._front

    @property
    def has_any(self) -> bool:
        """Whether a frame waits."""
        return bool(self._waiting)

    def _ahead(self) -> list[int]:
        return self._waiting[bisect_right(self._waiting, self._front) :]

    def _whose_turn(self) -> list[int]:
        """The candidates, of which the newest is next: those within reach ahead of the front, or else all skipped ones."""
        ahead = self._ahead()
        if not ahead:
            return self._waiting
        return ahead[: max(1, bisect_right(ahead, self._front + self._reach))]


class InTurn:
    """Frames of several aircraft: each one's newest first, and the aircraft in turn, so that none starves whoever sends more.

    An aircraft with a frame that is newer than its newest on the map comes before those that have only skipped ones to fill
    in; among alike, the one whose last turn is longest ago. A frame that is to come soon keeps its turn though a newer one of
    its aircraft comes: where frames come faster than they are prepared, none would ever be ready otherwise.

    `at_once`: how many are prepared at a time while several aircraft have new ones. Those chosen earlier than the machine can
    prepare them are older when they come on the map.
    """

    def __init__(self, at_once: int = AHEAD) -> None:
        self._at_once = at_once
        self._turns: dict[Aircraft, NewestFirst] = {}
        self._whose: dict[int, Aircraft] = {}
        self._last: dict[Aircraft, int] = {}  # count of turns when it had its last one
        self._count = 0
        self._promised: dict[Aircraft, int] = {}  # frames that are to come soon, in the order of their turns

    def add(self, frame: int, aircraft: Aircraft = None) -> None:
        self._whose[frame] = aircraft
        self._turns.setdefault(aircraft, NewestFirst()).add(frame)

    def next(self, begun: Collection[int]) -> int | None:
        self._keep_promises()
        for frame in self._promised.values():
            if frame in begun:
                return frame
        for aircraft in self._alike():
            own = [frame for frame in begun if self._whose[frame] == aircraft]
            if (found := self._turns[aircraft].next(own)) is not None:
                return found
        return None

    def remove(self, frame: int) -> None:
        aircraft = self._whose[frame]
        self._turns[aircraft].remove(frame)
        self._count += 1
        self._last[aircraft] = self._count
        if self._promised.get(aircraft) == frame:
            del self._promised[aircraft]

    def soon(self) -> list[int]:
        """The first of each aircraft in turn; of the only one that has frames, what comes next of it."""
        order = self._order()
        if len(order) == 1:
            return self._turns[order[0]].soon()
        self._keep_promises()
        most = self._at_once if sum(self._turns[one].has_new for one in order) > 1 else AHEAD
        for aircraft in order:
            if len(self._promised) < most and aircraft not in self._promised:
                self._promised[aircraft] = self._turns[aircraft].soon()[0]
        return list(self._promised.values())

    def _keep_promises(self) -> None:
        """But for frames that only fill in, once a new one waits."""
        if any(turns.has_new for turns in self._turns.values()):
            kept = {one: frame for one, frame in self._promised.items() if self._turns[one].is_new(frame)}
            self._promised = kept

    def processed(self, frame: int, on_map: Collection[int], *, waits: bool) -> None:
        for aircraft, turns in self._turns.items():
            own = [other for other in on_map if self._whose[other] == aircraft]
            if aircraft == self._whose[frame]:
                turns.processed(frame, own, waits=waits)
            elif own:
                turns.processed(max(own), own, waits=False)

    def _order(self) -> list[Aircraft]:
        """The aircraft that have frames, whose turn is next first."""
        waiting = [aircraft for aircraft, turns in self._turns.items() if turns.has_any]
        return sorted(waiting, key=lambda one: (not self._turns[one].has_new, self._last.get(one, 0)))

    def _alike(self) -> list[Aircraft]:
        """Those of them that may be next: with new frames, if any has."""
        order = self._order()
        new = [aircraft for aircraft in order if self._turns[aircraft].has_new]
        return new or order
