"""Whose turn it is, among frames that wait to be processed. A frame is its number in the order of capture: 0, 1, 2, ..."""

from __future__ import annotations

import math
from bisect import bisect_right, insort
from collections.abc import Collection
from typing import Protocol

AHEAD = 2  # decoded frames in memory besides the one in hand: 36 MB each at 12 MP


class Turns(Protocol):
    """Frames that wait, and which of them is next."""

    def add(self, frame: int) -> None:
        """A frame has come."""

    def next(self, begun: Collection[int]) -> int | None:
        """Whose turn it is, of those whose preparation has begun; None while that of no frame whose turn it may be has."""

    def remove(self, frame: int) -> None:
        """A frame waits no more."""

    def soon(self) -> list[int]:
        """Those, at most AHEAD, whose turn comes soonest if nothing new comes; the next one first."""

    def processed(self, frame: int, on_map: Collection[int], *, waits: bool) -> None:
        """What became of a frame: which ones found their place with it, or whether it matches nothing so far."""


class AsTheyCame:
    """The oldest is first: the same frames give the same map, whatever the machine."""

    def __init__(self) -> None:
        self._waiting: list[int] = []

    def add(self, frame: int) -> None:
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
    """The newest is first, so that the map shows where the aircraft is now, however many frames wait.

    What is passed over is filled in when nothing newer waits: from the newest back, each beside one that is on the map. The
    front is the newest frame on the map. If a frame ahead of it finds no overlap there, one half as far ahead is next, and so
    on until one finds its place, and often the others with it. Where not even the frame after the front matches, the flight
    itself has lost its overlap, and what comes behind the gap is the front.
    """

    def __init__(self) -> None:
        self._waiting: list[int] = []  # the oldest first
        self._front = -1
        self._reach = math.inf  # how many frames ahead of the front the next one may be

    def add(self, frame: int) -> None:
        insort(self._waiting, frame)

    def next(self, begun: Collection[int]) -> int | None:
        among = self._whose_turn()
        return max((frame for frame in begun if among and among[0] <= frame <= among[-1]), default=None)

    def remove(self, frame: int) -> None:
        self._waiting.remove(frame)

    def soon(self) -> list[int]:
        """While several new frames wait, the newest alone: the machine has enough to do."""
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

    def _ahead(self) -> list[int]:
        return self._waiting[bisect_right(self._waiting, self._front) :]

    def _whose_turn(self) -> list[int]:
        """Those among which the newest is next: ahead of the front as far as it may be, or else all that were passed over."""
        ahead = self._ahead()
        if not ahead:
            return self._waiting
        return ahead[: max(1, bisect_right(ahead, self._front + self._reach))]
