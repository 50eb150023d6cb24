"""Points many of which are wrong: a majority that agrees lays the map, halves that contradict each other are told of."""

from __future__ import annotations

import math
from collections import Counter
from typing import Literal

import numpy as np
import pytest

from gcs_mosaic.geo import gross_errors
from gcs_mosaic.geo.pins import USUAL_SIGMA_M, Pin, PinnedMap, anchored_by_pins
from tests.benchmarks.control_points import PLANE, SIDE, TRUTH, off_m

How = Literal["same", "own"]  # the wrong points are off by one and the same shift, or each by its own


def pins(
    chance: np.random.Generator, count: int, wrong: int, how: How, metres: float, noise_m: float = 3.0
) -> tuple[list[Pin], set[str]]:
    """Pins of so many points, the names of those that are wrong beside them."""
    places = chance.uniform(0, SIDE, (count, 2))
    offs = chance.normal(0, noise_m, (count, 2))
    at = chance.permutation(count)[:wrong]
    angles = chance.uniform(0, 2 * math.pi, 1 if how == "same" else wrong)
    sizes = metres * (1.0 if how == "same" else np.exp(chance.normal(0, 0.5, wrong)))
    offs[at] += np.stack([np.cos(angles) * sizes, np.sin(angles) * sizes], axis=-1)
    told = PLANE.places(PLANE.spots(TRUTH.places(places)) + offs).tolist()
    made = [Pin(f"q{k}", *places[k].tolist(), *told[k]) for k in range(count)]
    return made, {f"q{k}" for k in at.tolist()}


def fitted(some: list[Pin]) -> PinnedMap:
    found = anchored_by_pins(some)
    assert isinstance(found, PinnedMap), found
    return found


def in_the_middle(found: PinnedMap) -> tuple[float, float]:
    """How far off the map's middle is, and what is stated, metres."""
    return off_m(found.anchor, SIDE / 2, SIDE / 2), found.anchor.error(SIDE / 2, SIDE / 2).major_m


@pytest.mark.parametrize("how", ["same", "own"])
@pytest.mark.parametrize(
    ("count", "wrong", "metres"),
    [(6, 2, 1112.0), (9, 4, 1112.0), (10, 4, 1112.0), (10, 4, 222.0), (11, 5, 400.0), (20, 8, 300.0), (60, 25, 300.0)],
)
def test_a_majority_that_agrees_lays_the_map(how: How, count: int, wrong: int, metres: float) -> None:
    """Four of ten a hundredth of a degree too far north: good points were left out, and the map lay 370 m off, "\u00b1 31 m"."""
    some, names = pins(np.random.default_rng(2), count, wrong, how, metres, noise_m=0.1)
    found = fitted(some)
    assert set(found.misfits) == names
    off, stated = in_the_middle(found)
    assert off < stated < 6.0
    assert max(missed for one, missed in zip(some, found.residuals_m, strict=True) if one.name not in names) < 2.0


@pytest.mark.parametrize(
    ("count", "metres"), [(6, 1112.0), (6, 111.0), (8, 222.0), (10, 1112.0), (10, 111.0), (40, 300.0)]
)
@pytest.mark.parametrize("seed", range(3))
def test_halves_that_contradict_each_other_are_told_of(count: int, metres: float, seed: int) -> None:
    """Nothing says which half is right, also where one is the tighter: neither is chosen, and the error is that of both."""
    some, _ = pins(np.random.default_rng(seed), count, count // 2, "same", metres)
    found = fitted(some)
    assert (found.fits, found.checked, found.misfits) == (False, False, ())
    off, stated = in_the_middle(found)
    assert 0.4 * metres < stated
    assert off < 1.25 * stated


def test_a_half_that_is_the_tighter_is_not_the_likelier() -> None:
    some, names = pins(np.random.default_rng(1), 10, 5, "same", 500.0, noise_m=0.05)
    rougher, _ = pins(np.random.default_rng(1), 10, 5, "same", 500.0, noise_m=3.0)
    found = fitted([rough if one.name in names else one for one, rough in zip(some, rougher, strict=True)])
    assert not found.misfits
    assert in_the_middle(found)[1] > 200.0


def test_a_further_wrong_point_does_not_hide_that_halves_contradict_each_other() -> None:
    chance = np.random.default_rng(1)
    halves, _ = pins(chance, 8, 4, "same", 300.0)
    (alone,), _ = pins(chance, 1, 1, "own", 2000.0)
    found = fitted([*halves, Pin("alone", alone.x, alone.y, alone.longitude_deg, alone.latitude_deg)])
    assert (found.fits, found.misfits) == (False, ())
    assert in_the_middle(found)[1] > 120.0


def test_points_that_agree_in_nothing_lay_no_map_well() -> None:
    for seed in range(5):
        found = fitted(pins(np.random.default_rng(seed), 12, 11, "own", 500.0)[0])
        off, stated = in_the_middle(found)
        assert not found.fits
        assert off < stated
        assert stated > 100.0


def test_good_points_are_not_called_wrong_for_being_many() -> None:
    found = fitted(pins(np.random.default_rng(3), 40, 0, "own", 0.0)[0])
    assert found.is_checked
    assert in_the_middle(found)[1] < 2.0


@pytest.mark.long
@pytest.mark.parametrize("how", ["same", pytest.param("own", marks=pytest.mark.thorough)])
def test_where_a_minority_is_wrong_the_stated_error_holds(how: How) -> None:
    """Of 5 to 12 points, at random; where it does not hold it is not far from it, or less than a pin's own, or the map is said to
    be unchecked."""
    chance, held, words = np.random.default_rng(7), [], Counter[str]()
    for _ in range(200):
        count = int(chance.integers(5, 13))
        wrong, metres = int(chance.integers(1, (count - 1) // 2 + 1)), float(chance.choice([60.0, 220.0, 1100.0]))
        some, names = pins(chance, count, wrong, how, metres, noise_m=float(chance.choice([0.1, 1.0, 3.0])))
        found = fitted(some)
        off, stated = in_the_middle(found)
        held.append(off <= stated)
        assert off <= max(2 * stated, USUAL_SIGMA_M) or not (found.misfits or found.is_checked)
        words["named" if set(found.misfits) == names else "misnamed" if set(found.misfits) - names else "unsure"] += 1
    assert np.mean(held) >= 0.93
    assert words["named"] > 160
    assert words["misnamed"] <= 2


def test_pairs_are_all_of_few_points_and_an_even_choice_of_many() -> None:
    assert gross_errors._pairs(4).tolist() == [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]]
    assert len(gross_errors._pairs(40)) == 780
    many = gross_errors._pairs(1000)
    assert 600 <= len(many) <= gross_errors.MOST_PAIRS
    assert len(np.unique(many)) > 700
    assert (many[:, 0] < many[:, 1]).all()
