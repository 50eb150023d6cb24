"""Metres of heights, by those flown above the ground, where the map lies by the crowns."""

import pytest

from gcs_mosaic.export.integral_file import above_map


@pytest.mark.parametrize(
    ("heights", "is_sought", "metres"),
    [
        ((-1.0,), True, 17.5),  # the map half way up: crowns of 17.5 m beneath an aircraft at 35 m
        ((0.0,), True, 35.0),
        ((0.3,), True, 50.0),  # a hill above the map's ground
        ((-0.75, -0.25, 0.0, 0.2), False, 20.0),
        ((0.0, 0.05), False, 35.0),
        ((0.3,), False, 35.0),  # of crowns that somebody looks at
    ],
)
def test_what_was_flown_reaches_down_to_the_ground(heights: tuple[float, ...], is_sought: bool, metres: float) -> None:
    assert above_map(35.0, heights, is_sought=is_sought) == pytest.approx(metres)
