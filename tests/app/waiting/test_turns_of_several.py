"""Whose turn it is when several aircraft send frames faster than they can be processed: in counts, without pictures."""

from __future__ import annotations

from collections import Counter
from itertools import pairwise

import pytest

from gcs_mosaic.app.waiting.turns import AHEAD, InTurn, prepared_at_once


class Skies:
    """Aircraft that take `rates[a]` frames in the time that one is processed; every frame finds its place, but for those of
    the one that is `lost`.

    `worked`: aircraft and number within it, in order; `late[a]`: after each piece of work that had to be done for it, how many
    of its frames are newer than its newest on the map.
    """

    def __init__(self, rates: dict[int, int], steps: int, begun: int | None = None, lost: int | None = None) -> None:
        self.turns, self.begun, self.lost = InTurn(), begun, lost
        self.whose: list[tuple[int, int]] = []  # aircraft, number within it; by the number of all
        self.came: Counter[int] = Counter()
        self.waiting: list[int] = []
        self.worked: list[tuple[int, int]] = []
        self.newest: dict[int, int] = {}
        self.late: dict[int, list[int]] = {one: [] for one in rates}
        for _ in range(steps):
            for aircraft, rate in rates.items():
                for _ in range(rate):
                    self.take(aircraft)
            self.work_off_one()
            for aircraft in rates:
                self.late[aircraft].append(self.came[aircraft] - 1 - self.newest.get(aircraft, -1))

    def take(self, aircraft: int) -> None:
        self.turns.add(len(self.whose), aircraft)
        self.waiting.append(len(self.whose))
        self.whose.append((aircraft, self.came[aircraft]))
        self.came[aircraft] += 1

    def work_off_one(self) -> None:
        begun = self.waiting if self.begun is None else self.turns.soon()
        frame = self.turns.next(begun)
        assert frame is not None
        self.turns.remove(frame)
        self.waiting.remove(frame)
        aircraft, number = self.whose[frame]
        self.worked.append((aircraft, number))
        self.newest[aircraft] = max(number, self.newest.get(aircraft, -1))
        waits = aircraft == self.lost
        self.turns.processed(frame, [] if waits else [frame], waits=waits)

    def work_off_all(self) -> None:
        while self.waiting:
            self.work_off_one()


@pytest.mark.parametrize("begun", [None, AHEAD])
def test_who_sends_more_takes_no_turn_from_the_others(begun: int | None) -> None:
    """One sends ten frames while one is processed, the others one: each still has every fourth turn, with its newest."""
    flown = Skies({1: 10, 2: 1, 3: 1, 4: 1}, steps=40, begun=begun)
    assert Counter(aircraft for aircraft, _ in flown.worked) == {1: 10, 2: 10, 3: 10, 4: 10}
    for aircraft in (2, 3, 4):
        turns = [k for k, (one, _) in enumerate(flown.worked) if one == aircraft]
        assert max(later - earlier for earlier, later in pairwise(turns)) == 4
        assert max(flown.late[aircraft][4:]) <= 4  # it may have been chosen a step ago


def test_the_newest_of_each_comes_first() -> None:
    flown = Skies({1: 2, 2: 2}, steps=6)
    assert flown.worked == [(1, 1), (2, 3), (1, 5), (2, 7), (1, 9), (2, 11)]


def test_skipped_frames_are_filled_in_only_while_nobody_has_a_new_one() -> None:
    flown = Skies({1: 3}, steps=4)
    flown.take(2)
    flown.take(2)
    flown.work_off_all()
    new, *rest = flown.worked[4:]
    assert new == (2, 1)
    assert sorted(rest) == [(1, number) for number in range(12) if number not in (2, 5, 8, 11)] + [(2, 0)]
    assert rest.index((2, 0)) <= 1  # it has its turn among those that are filled in, too


def test_every_frame_has_its_turn_in_the_end() -> None:
    flown = Skies({1: 5, 2: 1, 3: 2}, steps=20)
    flown.work_off_all()
    assert sorted(flown.worked) == sorted((one, number) for one in (1, 2, 3) for number in range(flown.came[one]))


def test_one_whose_frames_match_nothing_does_not_stop_the_others() -> None:
    """Aircraft 2 has lost the map: of all its frames none finds a place, and it tries one after another."""
    flown = Skies({1: 1, 2: 3}, steps=30, lost=2)
    assert Counter(aircraft for aircraft, _ in flown.worked) == {1: 15, 2: 15}
    assert max(flown.late[1][1:]) <= 1


def test_a_lone_aircraft_of_several_is_worked_off_as_a_lone_one() -> None:
    flown = Skies({7: 3}, steps=4)
    flown.work_off_all()
    assert [number for _, number in flown.worked] == [2, 5, 8, 11, 10, 9, 7, 6, 4, 3, 1, 0]


@pytest.mark.parametrize("takes", [1, 3, 6])
def test_frames_that_come_faster_than_they_are_prepared_have_their_turns(takes: int) -> None:
    """Two are prepared at a time, which takes some steps, and in each step every aircraft sends one more."""
    turns, begun, worked = InTurn(), dict[int, int](), Counter[int]()
    for step in range(120):
        for aircraft in range(4):
            turns.add(4 * step + aircraft, aircraft)
        soon = turns.soon()
        for frame in [frame for frame, since in begun.items() if step - since >= takes and frame not in soon]:
            del begun[frame]  # it makes room
        begun |= {frame: step for frame in soon if frame not in begun and len(begun) < AHEAD}
        turn = turns.next(begun)
        if turn is not None and step - begun[turn] >= takes:
            del begun[turn]
            turns.remove(turn)
            worked[turn % 4] += 1
            turns.processed(turn, [turn], waits=False)
    assert sum(worked.values()) >= 120 // takes - 4
    assert max(worked.values()) - min(worked.values()) <= 1


def test_while_several_have_new_frames_no_more_are_begun_than_the_cores_can_prepare() -> None:
    turns = InTurn(at_once=1)
    for frame in range(8):
        turns.add(frame, frame % 4)
    for newest in (4, 5, 6):
        assert turns.soon() == [newest]  # the others are chosen later, when newer ones may have come
        turns.remove(newest)
        turns.processed(newest, [newest], waits=False)
    assert turns.soon() == [7, 0]  # a single one has a new frame: a skipped one is prepared beside it


def test_two_cores_prepare_one_frame_of_several_aircraft_at_a_time() -> None:
    assert [prepared_at_once(cores) for cores in (1, 2, 3, 4, 16)] == [1, 1, 1, 2, AHEAD]
