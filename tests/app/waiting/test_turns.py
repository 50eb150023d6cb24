"""Whose turn it is when frames come faster than they can be processed: flights in counts, without pictures."""

from __future__ import annotations

import pytest

from gcs_mosaic.app.waiting.turns import AsTheyCame, NewestFirst, Turns


class Flown:
    """A flight whose frames match those at most `overlap` frames away, none across the places where it is `torn`.

    `rate` frames come in the time that one is processed. `late`: after each piece of work, how many frames newer than the
    newest on the map have come.
    """

    def __init__(self, turns: Turns, frames: int, rate: int, overlap: int, torn: frozenset[int] = frozenset()) -> None:
        self.turns, self.overlap, self.torn = turns, overlap, torn
        self.on_map: set[int] = set()
        self.waits: set[int] = set()
        self.waiting: list[int] = []
        self.worked: list[int] = []
        self.late: list[int] = []
        for first in range(0, frames, rate):
            for frame in range(first, min(frames, first + rate)):
                turns.add(frame)
                self.waiting.append(frame)
            self.work_off_one()
            self.late.append(min(frames, first + rate) - 1 - max(self.on_map))
        while self.waiting:
            self.work_off_one()

    def work_off_one(self) -> None:
        frame = self.turns.next(self.waiting)
        assert frame is not None
        self.turns.remove(frame)
        self.worked.append(frame)
        self.waiting.remove(frame)
        found = self.found(frame)
        self.turns.processed(frame, found, waits=frame not in found)

    def found(self, frame: int) -> list[int]:
        """The frame and those that waited for it, as far as they match anything; two that match found an island."""
        if len(self.worked) == 1:
            self.on_map.add(frame)
            return [frame]
        self.waits.add(frame)
        found: list[int] = []
        while new := [w for w in self.waits if self.matches(w, self.on_map)]:
            found += new
            self.on_map |= set(new)
            self.waits -= set(new)
        if not found and (beside := [w for w in self.waits - {frame} if self.matches(w, {frame})]):
            found = [frame, beside[0]]
            self.on_map |= set(found)
            self.waits -= set(found)
        return found

    def matches(self, frame: int, others: set[int]) -> bool:
        return any(abs(frame - other) <= self.overlap and self.one_side(frame, other) for other in others)

    def one_side(self, a: int, b: int) -> bool:
        return not any(min(a, b) < tear <= max(a, b) for tear in self.torn)


@pytest.mark.parametrize("rate", [1, 2, 3])
def test_the_newest_is_on_the_map_while_steps_overlap(rate: int) -> None:
    flown = Flown(NewestFirst(), frames=90, rate=rate, overlap=3)
    assert sorted(flown.worked) == list(range(90))
    assert max(flown.late) == 0
    assert not flown.waits


def test_what_was_passed_over_is_filled_in_from_the_newest_back() -> None:
    flown = Flown(NewestFirst(), frames=12, rate=3, overlap=3)
    assert flown.worked == [2, 5, 8, 11, 10, 9, 7, 6, 4, 3, 1, 0]


@pytest.mark.parametrize("overlap", [1, 2])
def test_where_a_step_is_too_far_the_map_grows_towards_the_newest(overlap: int) -> None:
    """A frame's way or two overlap, three come meanwhile: the map stays some frames behind, but no more and more."""
    flown = Flown(NewestFirst(), frames=300, rate=3, overlap=overlap)
    assert sorted(flown.worked) == list(range(300))
    assert not flown.waits
    assert max(flown.late) <= 18


def test_after_a_burst_the_newest_soon_has_its_place() -> None:
    """Forty frames at once after the first: halving the way finds how far a step may go."""
    flown = Flown(NewestFirst(), frames=40, rate=39, overlap=10)
    assert len(flown.on_map) == 40
    assert flown.worked.index(39) < 8


def test_behind_a_gap_in_the_flight_the_newest_is_first_again() -> None:
    flown = Flown(NewestFirst(), frames=90, rate=3, overlap=4, torn=frozenset({31}))
    assert sorted(flown.worked) == list(range(90))
    assert not flown.waits
    assert flown.late[:10] == [0] * 10
    assert max(flown.late) <= 9
    assert flown.late[-10:] == [0] * 10


def test_without_a_backlog_frames_are_worked_off_as_they_came() -> None:
    torn = frozenset({5, 9})
    assert Flown(NewestFirst(), frames=30, rate=1, overlap=1, torn=torn).worked == list(range(30))
    assert Flown(AsTheyCame(), frames=30, rate=3, overlap=3).worked == list(range(30))


def test_who_is_next_is_known_ahead() -> None:
    turns = NewestFirst()
    for frame in range(6):
        turns.add(frame)
    assert turns.soon() == [5]  # nothing else while several new ones wait
    assert turns.next([]) is None
    assert turns.next([3, 4]) == 4  # rather an older one than none
    turns.remove(4)
    turns.processed(4, [4], waits=False)
    assert turns.soon() == [5, 3]
    assert turns.next([3]) is None
    assert turns.next([5, 3]) == 5
    turns.remove(5)
    turns.processed(5, [5], waits=False)
    assert turns.soon() == [3, 2]
    assert AsTheyCame().soon() == []
