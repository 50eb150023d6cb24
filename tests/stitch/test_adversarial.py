"""Flights that invite false joins: ground that repeats itself, look-alikes, writing in the picture, two flights in one folder.

A frame may wait for ever; it must never lie where it was not taken. `tests/benchmarks/strangers.py` does it at length.
"""

import pytest
from adversarial_flights import Shot, assert_nothing_is_mixed_up, in_turn, islands_of, shots, stitched, written_on

from tests.tiers import thorough

pytestmark = pytest.mark.long


@pytest.mark.parametrize("ground", [thorough("rows"), "cars"])
def test_ground_that_repeats_itself_misplaces_nothing(ground: str) -> None:
    taken = in_turn(*(shots(ground, seed, frames=6) for seed in (1, 2)))
    mosaic = stitched(taken)
    assert_nothing_is_mixed_up(mosaic, taken)
    assert len(mosaic.placements()) >= 10


@pytest.mark.thorough
def test_halls_of_one_make_join_no_two_places() -> None:
    taken = in_turn(*(shots("halls", seed, frames=7) for seed in (1, 2)))
    mosaic = stitched(taken)
    assert_nothing_is_mixed_up(mosaic, taken)
    assert [len(island) for island in islands_of(mosaic)] == [7, 7]


@pytest.mark.thorough
def test_writing_in_every_picture_joins_no_two_places() -> None:
    taken = in_turn(*(shots("country", seed, frames=6, seen=written_on) for seed in (1, 2)))
    mosaic = stitched(taken)
    assert_nothing_is_mixed_up(mosaic, taken)
    assert len(mosaic.placements()) >= 10


def test_waves_that_have_moved_on_are_nowhere() -> None:
    """Out over the water and back: each picture of water shows other waves."""
    shore = shots("country", 1, frames=5)
    water = [shots("water", seed, frames=1)[0] for seed in range(2, 8)]
    mosaic = stitched([*shore[:3], *water, *shore[3:]])
    assert {placement.name for placement in mosaic.placements()} == {shot.name for shot in shore}
    assert_nothing_is_mixed_up(mosaic, [*shore, *water])


@pytest.mark.thorough
def test_a_second_visit_after_a_long_absence_closes_the_map() -> None:
    """Away over other land for longer than anything is near, then over the first ground again, from elsewhere."""
    first, again = shots("country", 1, frames=4), shots("country", 1, frames=9)[4:]
    taken = [*first, *shots("country", 2, frames=7), *again]
    taken = [Shot(f"{i:03}", shot.features, shot.world, shot.ground) for i, shot in enumerate(taken)]
    mosaic = stitched(taken)
    assert_nothing_is_mixed_up(mosaic, taken)
    assert [len(island) for island in islands_of(mosaic)] == [9, 7]
