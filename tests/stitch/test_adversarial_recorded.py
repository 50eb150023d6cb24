"""Recorded flights mixed into each other, frame by frame. `tests/benchmarks/strangers.py --mixed` does it at length."""

from itertools import combinations

import pytest
from adversarial_flights import assert_nothing_is_mixed_up, in_turn, recorded, stitched

from tests.benchmarks.recorded import RECORDED, SHARED
from tests.tiers import thorough

FRAMES = 4
PLACED = {"caliterra": 4, "copr": 4, "cmac": 4, "guangzhou": 4}  # of the first frames of these, however they are mixed

PAIRS = list(combinations(RECORDED, 2))
OF_EACH = list(zip(RECORDED, reversed(RECORDED), strict=True))[: len(RECORDED) // 2]

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(not SHARED.is_dir(), reason="the recorded flights are not beside the project"),
]


@pytest.mark.parametrize(("one", "other"), [OF_EACH[0], *(thorough(*pair) for pair in PAIRS if pair != OF_EACH[0])])
def test_two_recorded_flights_in_one_folder_stay_apart(one: str, other: str) -> None:
    taken = in_turn(recorded(one, FRAMES), recorded(other, FRAMES))
    mosaic = stitched(taken)
    assert_nothing_is_mixed_up(mosaic, taken)
    placed = {placement.name for placement in mosaic.placements()}
    for flight in {one, other} & PLACED.keys():
        assert sum(shot.name in placed for shot in recorded(flight, FRAMES)) >= PLACED[flight]
