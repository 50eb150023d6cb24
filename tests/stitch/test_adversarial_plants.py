"""Rows of crops, orchards and their like: everything looks as it does one row further on."""

import pytest
from adversarial_flights import ONE_LINE, assert_nothing_is_mixed_up, in_turn, shots, stitched, with_a_gap

pytestmark, THOROUGH = pytest.mark.long, pytest.mark.thorough


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("crop", "height"),
    [("maize", 40), *(pytest.param(crop, 60, marks=THOROUGH) for crop in ("berries", "vines"))],
)
def test_fields_of_one_crop_stay_apart_and_are_placed(crop: str, height: float) -> None:
    taken = in_turn(*(shots(crop, seed, frames=6, height=height) for seed in (1, 2)))
    assert assert_nothing_is_mixed_up(stitched(taken), taken).islands == (6, 6)


@pytest.mark.parametrize("crop", ["maize", pytest.param("vines", marks=THOROUGH)])
def test_a_gap_across_a_field_is_never_closed_one_row_off(crop: str) -> None:
    taken = in_turn(*(with_a_gap(shots(crop, seed, **ONE_LINE)) for seed in (1, 2)))
    assert assert_nothing_is_mixed_up(stitched(taken), taken).islands == (3, 3, 3, 3)


@pytest.mark.thorough
def test_orchards_of_one_grid_flown_low_stay_apart() -> None:
    """Crowns of a quarter of the flying height: what is easily placed is little."""
    taken = in_turn(*(shots("orchard", seed, frames=6, height=40, relief=1) for seed in (1, 2)))
    assert assert_nothing_is_mixed_up(stitched(taken), taken, within=0.03).placed >= 8


@pytest.mark.thorough
def test_orchards_of_one_grid_stay_apart_and_are_placed() -> None:
    taken = in_turn(*(shots("orchard", seed, frames=6, height=60, relief=1, forward=0.85) for seed in (1, 2)))
    assert assert_nothing_is_mixed_up(stitched(taken), taken, within=0.03).islands == (6, 6)


@pytest.mark.thorough
def test_two_woods_stay_apart() -> None:
    taken = in_turn(*(shots("canopy", seed, frames=5, height=60, relief=1, forward=0.85) for seed in (1, 2)))
    assert assert_nothing_is_mixed_up(stitched(taken), taken, within=0.03).islands == (5, 5)
