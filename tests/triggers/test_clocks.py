from __future__ import annotations

import math
from dataclasses import replace

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from gcs_mosaic.mavlink.clock import clock_of, plausible_utc
from gcs_mosaic.mavlink.messages import decode
from gcs_mosaic.messages import FEEDBACK_WRAP_S, TriggerEvent
from gcs_mosaic.triggers.clocks import DRIFT, JUMP_S, OffsetClock, SourceClocks
from tests.mavlink.mavlink_peer import feedback
from tests.mavlink.mavlink_peer import received as heard

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


@given(st.floats(0, 20_000), st.lists(st.tuples(st.floats(0.5, 300), st.floats(0, 3)), min_size=1, max_size=20))
def test_feedback_that_wraps_after_71_minutes_is_never_misdated(boot: float, shots: list[tuple[float, float]]) -> None:
    clocks, now = SourceClocks(), 0.0
    for gap, delay in [(0.0, 0.0), *shots]:
        now += gap
        event = feedback_of((boot + now) % FEEDBACK_WRAP_S, now + delay)
        assert clocks.moment(event) == pytest.approx(now, abs=DRIFT * now + 0.001)


@given(st.floats(1, 1e5), st.floats(0, 60), st.floats(5, 120), delays)
def test_after_a_reboot_moments_are_right_from_the_third_message_on(
    uptime: float, booted: float, down: float, delays: list[float]
) -> None:
    clocks = SourceClocks()
    for second in range(3):
        clocks.moment(feedback_of((uptime + second) % FEEDBACK_WRAP_S, second))
    for second, delay in enumerate(delays):
        happened = 3.0 + down + 2 * second
        moment = clocks.moment(feedback_of(booted + 2 * second + 0.001, happened + 0.1 * delay))
        if second >= 2:
            assert abs(moment - happened) <= JUMP_S + 0.31


def feedback_of(source_time: float, received: float) -> TriggerEvent:
    event = decode(heard(feedback(1, time_usec=1)), received)
    assert event is not None
    return replace(event, source_time=source_time)


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


@given(st.floats(70, 4000), st.floats(0, 60), st.floats(1, 600))
def test_the_first_message_after_a_reboot_is_dated_right(uptime: float, booted: float, waited: float) -> None:
    """As after a change of batteries: the shot was dated back by as long as the aircraft had been on."""
    # Later it may as well be a message that came late, after the counter ran over.
    assume(uptime + 2 + waited < FEEDBACK_WRAP_S - JUMP_S)
    clocks = SourceClocks()
    for second in range(3):
        clocks.moment(feedback_of(uptime + second, 100.0 + second))
    came = 102.0 + waited + booted
    assert clocks.moment(feedback_of(booted, came)) == pytest.approx(came, abs=0.1)
    assert clocks.moment(feedback_of(booted + 2.0, came + 2.5)) == pytest.approx(came + 2.0, abs=0.1)


def test_an_old_message_that_is_sent_again_is_no_reboot() -> None:
    clock = OffsetClock()
    assert clock.moment(100.0, 1000.0) == 1000.0
    assert clock.moment(102.0, 1002.0) == pytest.approx(1002.0, abs=0.01)
    assert clock.moment(60.0, 1004.0) == pytest.approx(960.0, abs=0.01)
    assert clock.moment(106.0, 1006.0) == pytest.approx(1006.0, abs=0.01)
