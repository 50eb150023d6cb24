"""What is paired is looked over again: a change has to earn itself, and what is as likely is said."""

from __future__ import annotations

import random

import pytest

from gcs_mosaic.messages import Frame, TriggerEvent
from gcs_mosaic.triggers import Matched
from gcs_mosaic.triggers.alignment import Alignment, align
from gcs_mosaic.triggers.rulers import FileClue, ShotClue
from tests.factories import frame
from tests.triggers.test_matcher import Flight, shot

LETTERS = "abcdefghijklmnopqrstuvwxyz"


def flown(seed: int, off: dict[int, float], late: dict[int, float], turn_s: float = 7.0) -> Flight:
    """Shots at an even pace in lines of ten, whose names tell nothing. `off`, `late`: seconds of the camera's clock and of a
    file's arrival."""
    dice, items, at = random.Random(seed), list[tuple[int, TriggerEvent] | Frame](), 100.0
    for number in range(16):
        came = at + 1.2 + 0.3 * dice.random() + late.get(number, 0.0)
        items += [
            (number, shot(at, number + 1)),
            frame(f"{LETTERS[number]}-x.jpg", came, captured=at + 1000 + off.get(number, 0.0)),
        ]
        at += turn_s if number % 10 == 9 else 2.0
    return Flight().fly(*items)


def closed(flight: Flight) -> Flight:
    flight.outcomes += flight.pairing.close()
    return flight


def wrong(flight: Flight) -> dict[int, str]:
    return {number: name for number, name in flight.pairs().items() if name != f"{LETTERS[number]}-x.jpg"}


@pytest.mark.parametrize(
    ("off", "late", "turn_s"),
    [
        ({1: 1.5, 2: 1.5}, 9, 7.0),
        ({0: 1.5, 1: 1.5}, 14, 10.0),
        ({0: 1.5, 3: -1.5}, 14, 10.0),
        ({0: 1.5, 2: 1.5}, 13, 8.0),
        ({2: -1.5, 3: -1.5}, 15, 7.0),
    ],
)
def test_pictures_whose_clock_is_off_shift_no_others_at_any_time(
    off: dict[int, float], late: int, turn_s: float
) -> None:
    """Old shots were judged with the files of newer ones, too: by leaving the first ones out no clock was off."""
    flight = closed(flown(1, off, {late: 31.0}, turn_s))
    told = [one for one in flight.outcomes if isinstance(one, Matched)]
    assert [(one.event_id, one.frame.name) for one in told if one.frame.name != f"{LETTERS[one.event_id]}-x.jpg"] == []
    assert len(flight.pairs()) >= 15


def test_what_a_clock_that_is_off_exchanges_stays_as_it_came() -> None:
    """The first picture seems to be taken after the second, a half second from the other's shot each."""
    flight = closed(flown(1, {0: 1.5, 1: -1.5}, {}))
    assert not wrong(flight)


def test_a_file_that_comes_much_later_is_known_by_the_cameras_clock() -> None:
    pairs = closed(flown(3, {}, {5: 31.0, 11: 50.0})).pairs()
    assert (pairs[5], pairs[11]) == ("f-x.jpg", "l-x.jpg")


def test_in_flight_a_late_file_is_found_its_shot_where_the_clock_is_off_elsewhere() -> None:
    flight = flown(1, {1: -300.0, 2: 500.0}, {5: 20.0})
    assert flight.pairs()[5] == "f-x.jpg"
    assert not flight.pairing.doubts.is_part


def test_a_shot_that_nobody_counted_keeps_no_file_that_numbers_give_to_another() -> None:
    """The camera counts on by one; of the ninth another sender told, too, a little earlier and without a number."""
    items = [(number, shot(2.0 * number, 100 + number)) for number in range(20)]
    items.append((99, shot(15.7)))
    pairs = Flight().fly(*items, *(frame(f"IMG_{n + (n >= 8):04}.JPG", 2.0 * n + 1.0) for n in range(20))).pairs()
    assert pairs == {n: f"IMG_{n + (n >= 8):04}.JPG" for n in range(20)}


@pytest.mark.parametrize("seed", [7, 12, 15, 22, 23, 28])  # 17 of 60 were paired wrongly, or doubted
def test_files_that_come_late_by_more_than_the_time_between_two_shots_shift_none(seed: int) -> None:
    """Over a slow link: a delay that scatters evenly looks sharper by its densest half with one shift of the rows than with
    another, and all pictures were given to the shot after their own."""
    dice, items, at = random.Random(seed), list[tuple[int, TriggerEvent] | Frame](), 100.0
    for number in range(30):
        items += [(number, shot(at, number)), frame(f"DSC{4711 + number:05}.JPG", at + dice.uniform(1.0, 4.0))]
        at += dice.uniform(1.7, 2.3)
    flight = closed(Flight().fly(*items))
    assert flight.pairs() == {number: f"DSC{4711 + number:05}.JPG" for number in range(30)}
    assert not flight.pairing.doubts


@pytest.mark.parametrize("first", [65_530, 9], ids=["its end", "a reboot"])
def test_a_counter_that_begins_anew_makes_nothing_ambiguous(first: int) -> None:
    """At an even pace and without losses; the file numbers go on."""
    items = list[tuple[int, TriggerEvent] | Frame]()
    for number in range(16):
        count = first + number if number < 6 else number - 6
        items += [(number, shot(0.5 * number, count)), frame(f"DSC{4711 + number:05}.JPG", 0.5 * number + 0.35)]
    flight = closed(Flight().fly(*items))
    assert flight.pairs() == {number: f"DSC{4711 + number:05}.JPG" for number in range(16)}
    assert not flight.pairing.doubts


COUNT = 14


def compared(files: list[int], so_far: dict[int, int], off: dict[int, float], late: dict[int, float]) -> Alignment:
    """Of fourteen shots three seconds apart, with these files of theirs, and what they were paired with (places of files)."""
    shots = [ShotClue(3.0 * number) for number in range(COUNT)]
    clues = [FileClue({}, 3.0 * k + 50 + off.get(k, 0.0), 3.0 * k + 1 + late.get(k, 0.0)) for k in files]
    return align(shots, clues, pairs_so_far=sorted(so_far.items()))


def test_a_doubt_about_some_leaves_none_of_the_others_as_they_are() -> None:
    """Six were paired three later; what else the clocks that are off may mean does not concern them."""
    files = [*range(COUNT)]
    so_far = {k: k + 3 if k < 6 else k for k in files if k not in (6, 7, 8)}
    found = compared(files, so_far, {1: 1.5, 2: 1.4}, {})
    assert {(k, k) for k in (0, *range(3, 9))} <= found.sure
    assert {(k, k + 3) for k in range(6)} <= found.refuted


def test_each_change_has_to_be_likelier_by_itself() -> None:
    """Two were exchanged, which the clock tells. Of two others it says so, too, but they came as they are paired."""
    files = [0, 2, 1, *range(3, COUNT)]
    place = {whose: place for place, whose in enumerate(files)}
    so_far = {k: place[k] for k in range(COUNT)} | {8: place[9], 9: place[8]}
    found = compared(files, so_far, {1: 2.0, 2: -2.0}, {})
    assert found.sure == {(8, 8), (9, 9)}
    assert found.refuted == {(8, 9), (9, 8)}


def test_a_file_that_took_the_place_of_a_lost_one_and_may_be_an_older_shots_is_said() -> None:
    """It came 24 seconds late by the camera's clock, but just when the lost one was due."""
    files = [k for k in range(COUNT) if k != 12]
    found = compared(files, {k: place for place, k in enumerate(files) if k != 4} | {12: 4}, {}, {4: 24.0})
    assert found.pairs[4] == (4, 4)
    assert found.contested == 1
