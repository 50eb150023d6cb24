"""Ordinary flights that are paired right as they go: looking back over the whole stretch must not make them worse."""

from __future__ import annotations

import random

import pytest

from gcs_mosaic.messages import Frame, TriggerEvent
from tests.triggers.test_matcher import Flight, file, shot


@pytest.mark.parametrize("every", [0.5, 1.0])
@pytest.mark.parametrize("seed", range(4))
def test_losses_of_a_steady_row_do_not_shift_what_was_paired_in_flight(every: float, seed: int) -> None:
    """Shots at an even pace, a tenth of the messages and a tenth of the files lost: by a wrong shift one pair more may fit."""
    dice, items = random.Random(seed), list[tuple[int, TriggerEvent] | Frame]()
    for number in range(60):
        at = 100 + every * number + 0.02 * dice.random()
        if dice.random() < 0.9:
            items.append((number, shot(at + 0.1 * dice.random(), number, source_time=at, clock="boot")))
        if dice.random() < 0.9:
            items.append(file(at + 1.5 + 0.3 * dice.random(), f"IMG_{number + 7:04d}.JPG"))
    flight = Flight().fly(*items)
    in_flight = right(flight.pairs())
    flight.outcomes += flight.pairing.close()
    assert right(flight.pairs()) >= in_flight


@pytest.mark.parametrize("every", [0.5, 1.0])
def test_a_steady_row_that_may_as_well_be_shifted_is_said_to_be(every: float) -> None:
    """The first file is lost and the next one comes when the first was due: times and numbers fit a shot later as well."""
    dice, items = random.Random(2), list[tuple[int, TriggerEvent] | Frame]()
    for number in range(60):
        at = 100 + every * number
        if number < 2 or dice.random() < 0.9:
            items.append((number, shot(at, number, source_time=at, clock="boot")))
        if number and dice.random() < 0.9:
            items.append(file(at + 1.5 + 0.3 * dice.random(), f"IMG_{number + 7:04d}.JPG"))
    flight = Flight().fly(*items)
    flight.outcomes += flight.pairing.close()
    pairs = flight.pairs()
    assert right(pairs) > 0.9 * len(pairs) or flight.pairing.doubts


def right(pairs: dict[int, str]) -> int:
    return sum(name == f"IMG_{event + 7:04d}.JPG" for event, name in pairs.items())


@pytest.mark.parametrize("other", ["cam_{:03d}_left.jpg", "cam_{:03d}_thermal.jpg", "cam_{:03d}.jpg"])
@pytest.mark.parametrize("late", [1.0, 2.5])
def test_the_file_that_is_named_itself_comes_before_its_companions(other: str, late: float) -> None:
    """Two lenses, one event per shot that names the right one's file; the other's is there first, or comes later."""
    items, named = list[tuple[int, TriggerEvent] | Frame](), dict[int, str]()
    for number in range(12):
        at = 100 + 3.0 * number
        name = f"cam_{number:03d}_right.jpg"
        items += [(number, shot(at, number, name)), file(at + late, name), file(at + 1.5, other.format(number))]
        named[number] = name
    assert Flight().fly(*items).pairs() == named


def test_two_cameras_that_are_triggered_at_once_find_their_files_while_the_flight_goes_on() -> None:
    """As an autopilot with two cameras tells them: two messages of one moment, with counters of their own and no name."""
    flight = Flight()
    for n in range(10):
        at = 2.0 * n
        flight.fly(*((2 * n + camera, shot(at + 0.003 * camera, n, camera=camera)) for camera in range(2)))
        flight.fly(file(at + 0.4, f"DSC{n:05}.JPG"), file(at + 0.45, f"FLIR{n + 40:04}.JPG"))
    assert flight.pairing.tick(100.0) == []
    assert [flight.pairs()[2 * n][:3] for n in range(10)] == ["DSC"] * 10
    assert [flight.pairs()[2 * n + 1][:4] for n in range(10)] == ["FLIR"] * 10
