"""Flights of thousands of shots, their files copied after landing: paired as a whole in bounded time, or said to be in doubt."""

from __future__ import annotations

import random
import time
from itertools import starmap

import numpy as np
import pytest

from gcs_mosaic.messages import Frame, TriggerEvent
from gcs_mosaic.triggers.alignment import MOST
from gcs_mosaic.triggers.needleman_wunsch import Band, needleman_wunsch, whole
from gcs_mosaic.triggers.settings import PairingSettings
from tests.tiers import thorough
from tests.triggers.test_matcher import Flight, file, shot
from tests.triggers.test_ordinary_losses import right

CLOSED_WITHIN_S = 60.0  # some 10 s here; it is the square of the shots that must not come back


def landed(count: int, lost: float, untold: float, silent: range = range(0), seed: int = 0) -> Flight:
    """A flight of so many shots, two seconds apart, and then all its files in a few seconds. `silent`: shots nobody heard."""
    dice, items = random.Random(seed), list[tuple[int, TriggerEvent] | Frame]()
    for number in range(count):
        if dice.random() >= untold and number not in silent:
            items.append((number, shot(100.0 + 2 * number, number)))
    for number in range(count):
        if dice.random() >= lost:
            items.append(file(1000.0 + 2 * count + 0.01 * number, f"IMG_{number + 7:04d}.JPG"))
    flight = Flight().fly(*items)
    flight.outcomes += flight.pairing.close()
    return flight


@pytest.mark.long
def test_all_files_of_a_long_flight_are_paired() -> None:
    flight = landed(MOST + 200, 0.0, 0.0)
    assert right(flight.pairs()) == MOST + 200
    assert not flight.pairing.doubts


@pytest.mark.long
@pytest.mark.parametrize(
    ("lost", "untold"), [(0.03, 0.03), *starmap(thorough, ((0.1, 0.0), (0.0, 0.1), (0.002, 0.002)))]
)
def test_of_a_long_flight_with_losses_the_right_pairs_are_there_or_can_be_chosen(lost: float, untold: float) -> None:
    flight = landed(MOST + 200, lost, untold)
    pairs, doubts = flight.pairs(), flight.pairing.doubts
    assert len(pairs) >= (1 - lost) * (1 - untold) * (MOST + 200) - 40
    off = {int(name[4:8]) - 7 - event for event, name in pairs.items()}
    if right(pairs) < 0.99 * len(pairs):
        assert doubts, f"{off} shots off, and nothing is said"
        assert doubts.shifts


@pytest.mark.long
def test_a_link_that_was_gone_for_a_part_of_a_long_flight_shifts_nothing() -> None:
    flight = landed(MOST + 400, 0.0, 0.0, silent=range(300, 600))
    assert right(flight.pairs()) == len(flight.pairs()) >= MOST + 90


def test_of_more_than_can_be_held_is_said_that_they_are_not_paired() -> None:
    flight, settings = Flight(), PairingSettings(remembered=40)
    flight.pairing = type(flight.pairing)(settings)
    flight.fly(*((number, shot(100.0 + 2 * number, number)) for number in range(60)))
    flight.fly(*(file(900.0 + 0.01 * number, f"IMG_{number + 7:04d}.JPG") for number in range(60) if number % 10 != 3))
    flight.outcomes += flight.pairing.close()
    assert flight.pairs() == {}
    assert flight.pairing.doubts.is_part
    assert "replay" in flight.pairing.doubts.text()


@pytest.mark.long
def test_three_thousand_shots_take_a_bounded_time() -> None:
    before = time.process_time()
    flight = landed(3000, 0.0, 0.02, silent=range(1000, 1600))
    assert right(flight.pairs()) == len(flight.pairs()) > 2300
    assert time.process_time() - before < CLOSED_WITHIN_S


@pytest.mark.parametrize("seed", range(20))
def test_a_band_that_holds_the_best_alignment_finds_it(seed: int) -> None:
    """Rows with losses, also of many files or shots at a time, which the band has to step over."""
    rng = np.random.default_rng(seed)
    taken = np.sort(rng.choice(120, 100, replace=False))
    shots = taken[(rng.random(100) > 0.1) & ~((taken >= 40) & (taken < 70) & (seed % 3 == 1))]
    files = taken[(rng.random(100) > 0.1) & ~((taken >= 40) & (taken < 70) & (seed % 3 == 2))]
    scores = np.where(shots[:, None] == files[None, :], 2.2, -6.0) + rng.normal(0, 0.1, (len(shots), len(files)))
    best, file_of = needleman_wunsch(scores, whole(*scores.shape))
    width = 15
    middle = np.interp(np.arange(len(shots)), np.flatnonzero(file_of >= 0), file_of[file_of >= 0])
    band = Band(np.clip(np.rint(middle).astype(int) - width // 2, 0, len(files) - width), width, len(files))
    found, banded = needleman_wunsch(np.take_along_axis(scores, band.places[1], 1), band)
    assert np.array_equal(banded, file_of)
    assert found == pytest.approx(best, abs=2.0)  # shots lost at an end that the band does not show cost as elsewhere
