"""Repeated roofs and courts: blocks of one make in rows, with heights; only cars, growth and stains tell them apart."""

import pytest
from adversarial_flights import ONE_LINE, Route, assert_nothing_is_mixed_up, in_turn, shots, stitched, with_a_gap

pytestmark = pytest.mark.long


TWINS = pytest.mark.xfail(
    strict=True,
    raises=AssertionError,
    reason="all but parked cars and two bushes of a block is its neighbour's: whole pictures agree one block off, and are joined",
)


@pytest.mark.thorough
@pytest.mark.parametrize("blocks", ["quarter", pytest.param("barracks", marks=pytest.mark.thorough)])
def test_a_flight_along_the_rows_is_placed(blocks: str) -> None:
    taken = shots(blocks, 1, frames=8, height=80, relief=1)
    assert assert_nothing_is_mixed_up(stitched(taken), taken).islands == (8,)


@pytest.mark.parametrize("blocks", ["quarter", pytest.param("barracks", marks=[TWINS, pytest.mark.thorough])])
def test_a_gap_along_the_rows_is_never_closed_one_block_off(blocks: str) -> None:
    taken = with_a_gap(shots(blocks, 1, relief=1, **ONE_LINE | Route(height=75)))
    assert assert_nothing_is_mixed_up(stitched(taken), taken).placed == 6


@pytest.mark.thorough
@pytest.mark.parametrize("blocks", ["quarter", pytest.param("barracks", marks=TWINS)])
def test_quarters_of_one_make_stay_apart(blocks: str) -> None:
    taken = in_turn(*(shots(blocks, seed, frames=5, height=80, relief=1) for seed in (1, 2)))
    assert assert_nothing_is_mixed_up(stitched(taken), taken).placed == 10
