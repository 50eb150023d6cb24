"""What moves with the camera or of itself: glitter on water, and the pattern of a thermal camera that all its frames share."""

import pytest
from adversarial_flights import assert_nothing_is_mixed_up, in_turn, shots, stitched

from sitl.thermal import ThermalCamera
from tests.tiers import thorough

pytestmark = pytest.mark.long


LAKE_SIDE = 0.45  # of the lines over a lake


@pytest.mark.thorough
def test_glitter_joins_nothing_and_the_shore_does() -> None:
    """From land over the shore out to where only water is seen, whose frames wait for ever or lie where they were taken."""
    taken = shots("lake", 1, frames=12, forward=0.6, side=LAKE_SIDE)
    assert assert_nothing_is_mixed_up(stitched(taken), taken).placed >= 8


@pytest.mark.thorough
def test_two_lakes_under_one_sun_stay_apart() -> None:
    taken = in_turn(*(shots("lake", seed, frames=6, forward=0.7, side=LAKE_SIDE) for seed in (1, 2)))
    assert assert_nothing_is_mixed_up(stitched(taken), taken).placed >= 10


@pytest.mark.thorough
def test_the_pattern_of_a_thermal_camera_joins_no_two_places() -> None:
    camera = ThermalCamera()
    taken = in_turn(*(shots("country", seed, frames=6, seen=camera.picture) for seed in (1, 2)))
    assert assert_nothing_is_mixed_up(stitched(taken), taken).islands == (6, 6)


@pytest.mark.parametrize("writing", [thorough(False), True])
def test_a_pattern_stronger_than_the_ground_joins_nothing(writing: bool) -> None:
    camera = ThermalCamera(contrast=0.08, writing=writing)
    taken = in_turn(*(shots("country", seed, frames=4, seen=camera.picture) for seed in (1, 2)))
    assert_nothing_is_mixed_up(stitched(taken), taken)
