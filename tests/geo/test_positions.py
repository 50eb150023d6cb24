"""Anchors by the positions of the triggers: simulated flights with known truth."""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass, replace

import numpy as np
import pytest

from gcs_mosaic.geo.anchor import as_complex, joined, split
from gcs_mosaic.geo.ellipsoid import LocalPlane
from gcs_mosaic.geo.pins import Refused
from gcs_mosaic.geo.positions import LONGEST_LAG_S, PositionedMap, ShotPosition, anchored_by_positions

PLANE = LocalPlane(7.0, 44.5)
GSD_M, SPEED, EVERY_S = 0.05, 10.0, 2.0


@dataclass(frozen=True)
class Receiver:
    """How a simulated aircraft tells its positions."""

    sigma_m: float = 3.0
    wanders_s: float = 60.0
    lag_s: float = 0.0
    wrong: float = 0.0  # share that is 80 m off


@dataclass(frozen=True)
class Flight:
    shots: list[ShotPosition]
    true_m: np.ndarray  # (N, 2): east and north of the camera

    def missed(self, found: PositionedMap, at: int) -> float:
        """How far the anchor is off where a shot was, as a multiple of the stated ellipse."""
        shot = self.shots[at]
        off = PLANE.spots(found.anchor.places(np.array([shot.x, shot.y]))) - self.true_m[at]
        error = found.anchor.error(shot.x, shot.y)
        bearing = math.radians(error.bearing_deg)
        along = off @ [math.sin(bearing), math.cos(bearing)]
        across = off @ [math.cos(bearing), -math.sin(bearing)]
        return math.hypot(along / error.major_m, across / error.minor_m)


def flight(seed: int, receiver: Receiver, width: float = 300.0, height: float = 200.0, count: int = 75) -> Flight:
    """Lines of a survey to and fro, north-up or not by chance."""
    chance = np.random.default_rng(seed)
    times = np.arange(count) * EVERY_S
    true = path(times * SPEED, width, height, count)
    told = path((times + receiver.lag_s) * SPEED, width, height, count)
    told = told + wander(chance, receiver, count)
    told += (chance.random(count) < receiver.wrong)[:, None] * 80.0 * split(np.exp(1j * chance.uniform(0, 6.28, count)))
    turn = GSD_M * cmath.exp(1j * chance.uniform(0, 6.28))
    canvas = split(np.conj((as_complex(true) - complex(*true.mean(axis=0))) / turn))
    rows = zip(times, canvas, PLANE.places(told), strict=True)
    return Flight([ShotPosition(1000.0 + time, *place, *degrees) for time, place, degrees in rows], true)


def path(flown_m: np.ndarray, width: float, height: float, count: int) -> np.ndarray:
    lines = max(2, round(count * SPEED * EVERY_S / width))
    gap = height / (lines - 1)
    line = np.floor(flown_m / (width + gap))
    along = flown_m - line * (width + gap)
    east = np.minimum(along, width)
    return np.stack([np.where(line % 2 == 0, east, width - east), line * gap + np.maximum(along - width, 0)], axis=1)


def wander(chance: np.random.Generator, receiver: Receiver, count: int) -> np.ndarray:
    kept = math.exp(-EVERY_S / receiver.wanders_s) if receiver.wanders_s else 0.0
    error = chance.normal(0, receiver.sigma_m, (count, 2))
    for at in range(1, count):
        error[at] = kept * error[at - 1] + math.sqrt(1 - kept**2) * error[at]
    return error


def fitted(flown: Flight) -> PositionedMap:
    found = anchored_by_positions(flown.shots)
    assert isinstance(found, PositionedMap), found
    return found


def test_exact_positions_lay_the_map_exactly() -> None:
    flown = flight(1, Receiver(sigma_m=0.0))
    found = fitted(flown)
    assert found.anchor.metres_per_unit == pytest.approx(GSD_M, rel=1e-4)
    assert found.lag_s == pytest.approx(0.0, abs=0.01)
    assert found.outliers == 0
    assert max(flown.missed(found, at) for at in range(75)) < 0.05


@pytest.mark.parametrize("sign", [-1, 1])
def test_a_lag_beyond_all_that_are_tried_is_refused(sign: int) -> None:
    found = anchored_by_positions(flight(1, Receiver(sigma_m=0.01, lag_s=sign * (LONGEST_LAG_S + 0.5))).shots)
    assert isinstance(found, Refused)
    assert f"{LONGEST_LAG_S:.0f} s or more off" in found.reason


@pytest.mark.parametrize("lag_s", [-1.5, 0.4, 2.0])
def test_the_lag_is_found(lag_s: float) -> None:
    off = [fitted(flight(seed, Receiver(lag_s=lag_s))).lag_s - lag_s for seed in range(6)]
    assert np.median(np.abs(off)) < 0.05
    assert np.max(np.abs(off)) < 0.2


@pytest.mark.parametrize(
    "receiver", [Receiver(), Receiver(lag_s=1.0), Receiver(wrong=0.15), Receiver(sigma_m=10.0)], ids=str
)
def test_the_stated_error_holds(receiver: Receiver) -> None:
    missed = []
    for seed in range(8):
        flown = flight(seed, receiver)
        found = anchored_by_positions(flown.shots)
        if isinstance(found, PositionedMap):
            missed += [flown.missed(found, at) for at in (0, 25, 50, 74)]
    assert len(missed) >= 28
    assert np.mean(np.array(missed) <= 1) >= 0.9


@pytest.mark.long
@pytest.mark.thorough
def test_the_stated_error_holds_in_95_of_100_flights() -> None:
    receivers = [Receiver(), Receiver(lag_s=1.0), Receiver(wrong=0.15), Receiver(sigma_m=10.0), Receiver(lag_s=-2.0)]
    missed = []
    for seed in range(500):
        flown = flight(seed, receivers[seed % len(receivers)])
        found = anchored_by_positions(flown.shots)
        if isinstance(found, PositionedMap):
            missed += [flown.missed(found, at) for at in (0, 25, 50, 74)]
    assert len(missed) > 1800
    assert 0.93 <= np.mean(np.array(missed) <= 1) <= 0.99


def test_a_straight_line_says_that_it_knows_less_along_itself() -> None:
    flown = flight(3, Receiver(), width=2000.0, count=90)
    found = fitted(flown)
    error = found.anchor.error(flown.shots[45].x, flown.shots[45].y)
    assert error.major_m > 1.2 * error.minor_m
    assert abs(error.bearing_deg - 90) < 20


def test_a_receiver_that_never_tells_better_than_its_kind_is_not_believed_to_be() -> None:
    assert fitted(flight(1, Receiver(sigma_m=0.01))).anchor.error(0.0, 0.0).minor_m >= 4.5


FLOWN = flight(1, Receiver())


def moved(flown: Flight, at: slice, metres: float) -> list[ShotPosition]:
    return [
        replace(shot, latitude_deg=shot.latitude_deg + metres / 111e3) if shot in flown.shots[at] else shot
        for shot in flown.shots
    ]


@pytest.mark.parametrize(
    ("shots", "told"),
    [
        (FLOWN.shots[:7], "8 are needed"),
        ([replace(shot, x=shot.x * 1e-3, y=shot.y * 1e-3) for shot in FLOWN.shots], "not believed"),
        ([replace(shot, x=shot.x + 1e6 * (at % 2)) for at, shot in enumerate(FLOWN.shots)], "not believed"),
        (flight(1, Receiver(), width=15.0, height=10.0).shots, "lie within"),
        ([replace(shot, x=-shot.x) for shot in FLOWN.shots], "set pins"),  # mirrored
        (moved(FLOWN, slice(38, None), 150.0), "set pins"),
        ([replace(shot, longitude_deg=shot.longitude_deg + at) for at, shot in enumerate(FLOWN.shots)], "further"),
    ],
)  # fmt: skip
def test_what_is_refused_says_why(shots: list[ShotPosition], told: str) -> None:
    found = anchored_by_positions(shots)
    assert isinstance(found, Refused), found
    assert told in found.reason


def test_a_gap_in_the_flight_does_no_harm() -> None:
    flown = flight(4, Receiver(sigma_m=0.1, wanders_s=0.0, lag_s=1.0))
    shots = [shot for at, shot in enumerate(flown.shots) if not 30 <= at < 50]
    found = anchored_by_positions(shots)
    assert isinstance(found, PositionedMap)
    assert found.lag_s == pytest.approx(1.0, abs=0.05)


def test_shots_at_one_moment_and_out_of_order() -> None:
    flown = flight(5, Receiver())
    shots = [flown.shots[3], *flown.shots[::-1], flown.shots[7]]
    assert fitted(Flight(shots, flown.true_m)).lag_s == pytest.approx(fitted(flown).lag_s)


def test_joined_is_the_canvas_seen_from_above() -> None:
    assert joined(np.array([2.0, 3.0])) == 2 - 3j


@pytest.mark.parametrize("count", [1, 2, 7])
def test_a_sender_whose_clock_stands_still_lays_nothing(count: int) -> None:
    """And takes nothing away from other islands."""
    shots = [replace(shot, time_s=float(at % count)) for at, shot in enumerate(flight(1, Receiver()).shots)]
    refused = anchored_by_positions(shots)
    assert isinstance(refused, Refused)
    assert f"tell {count} different times" in refused.reason


def test_a_third_that_is_a_little_off_does_not_drag_exact_positions_along() -> None:
    flown = flight(1, Receiver(sigma_m=0.0))
    shots = [
        replace(shot, latitude_deg=shot.latitude_deg + 2.0 / 111e3 * (at % 10 in (2, 5, 9)))
        for at, shot in enumerate(flown.shots)
    ]
    found = fitted(Flight(shots, flown.true_m))
    middle = np.array([shot.x for shot in shots]).mean(), np.array([shot.y for shot in shots]).mean()
    off = PLANE.spots(found.anchor.places(np.array(middle))) - flown.true_m.mean(axis=0)
    assert np.hypot(*off) < 0.15
