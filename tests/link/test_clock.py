from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_mosaic.link.clock import OffsetClock, clock_of, plausible_utc

delays = st.lists(st.floats(0, 3), min_size=3, max_size=30)


@pytest.mark.parametrize(
    ("seconds", "clock"),
    [(0.0, "none"), (-1.0, "none"), (math.nan, "none"), (0.5, "boot"), (4294.9, "boot"), (1.7e9, "epoch")],
)
def test_boot_and_epoch_are_told_apart_by_magnitude(seconds: float, clock: str) -> None:
    assert clock_of(seconds) == clock


def test_absurd_years_are_not_shown() -> None:
    year_2908 = (2908 - 1970) * 365.25 * 86400
    assert plausible_utc(year_2908) is None
    assert plausible_utc(0.0) is None
    assert plausible_utc(1.75e9) == 1.75e9


@given(delays, st.floats(-1e6, 1e9))
def test_the_envelope_is_as_good_as_the_quickest_message(delays: list[float], ahead: float) -> None:
    clock = OffsetClock()
    for second, delay in enumerate(delays):
        moment = clock.moment(second + ahead, second + delay)
        assert moment <= second + delay + 1e-6
    assert moment - second == pytest.approx(min(delays), abs=0.01)


@given(st.floats(-1e9, 1e9), delays)
def test_a_clock_that_leaps_is_followed_after_three_messages(leap: float, delays: list[float]) -> None:
    clock = OffsetClock()
    for second, _ in enumerate(delays):
        clock.moment(second, second)
    for second in range(len(delays), len(delays) + 3):
        moment = clock.moment(second + leap, second)
    assert abs(moment - second) <= 5.01


def test_one_message_that_was_held_up_changes_nothing() -> None:
    clock = OffsetClock()
    assert clock.moment(100.0, 1000.0) == 1000.0
    assert clock.moment(105.0, 1035.0) == pytest.approx(1005.0, abs=0.01)
    assert clock.moment(140.0, 1040.0) == pytest.approx(1040.0, abs=0.01)


def test_a_burst_after_an_outage_is_dated_to_when_it_happened() -> None:
    clock = OffsetClock()
    clock.moment(0.0, 500.0)
    moments = [clock.moment(second, 560.0) for second in range(10, 50, 2)]
    assert moments == pytest.approx([500.0 + second for second in range(10, 50, 2)], abs=0.02)
