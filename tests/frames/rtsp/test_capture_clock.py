from __future__ import annotations

import numpy as np
import pytest

from gcs_mosaic.frames.rtsp.clock import SETTLED_S, CaptureClock

LATENCY_S = 0.15
UTC_OF_ZERO = 1.7e9  # of the host's monotonic clock


def heard(
    delays: list[float], camera_off_s: float | None = None, rate: float = 10.0, start: float = 500.0
) -> CaptureClock:
    """A clock that was told of pictures taken at 0.1 s, 0.2 s … on the monotonic clock; their own times count from -start."""
    clock = CaptureClock(0.0, LATENCY_S)
    for k, delay in enumerate(delays):
        taken = k / rate
        told = None if camera_off_s is None else taken + UTC_OF_ZERO + camera_off_s
        clock.note(taken + start, taken + delay, taken + delay + UTC_OF_ZERO, told)
    return clock


def test_the_fastest_arrival_tells_the_time_of_all() -> None:
    delays = list(LATENCY_S + np.random.default_rng(2).exponential(0.2, 100))
    clock = heard([*delays, LATENCY_S, 3.0])
    assert clock.moment(500.0 + 42.0) == pytest.approx(42.0, abs=0.01)


def test_what_a_camera_had_in_store_is_dated_when_live_pictures_have_come() -> None:
    """The first two seconds of pictures come at once."""
    stored = [2.0 - k / 10 + LATENCY_S for k in range(20)]
    clock = heard([*stored, *[LATENCY_S] * 10])
    assert clock.moment(500.0) == pytest.approx(0.0, abs=0.01)
    assert not clock.is_settled(SETTLED_S / 2)
    assert clock.is_settled(SETTLED_S)


def test_a_camera_whose_clock_is_set_is_believed() -> None:
    clock = heard([0.4] * 20, camera_off_s=0.0)
    assert clock.believes_the_camera
    assert clock.moment(500.0 + 1.0) == pytest.approx(1.0, abs=0.001)


@pytest.mark.parametrize("step_s", [-3600.0, -3.0, 3.0, 3600.0])
def test_a_camera_is_believed_again_after_the_host_s_clock_was_set(step_s: float) -> None:
    """It was a little off before, by less than the step, and is right after it."""
    clock = heard([0.4] * 20, camera_off_s=step_s)
    for k in range(20, 40):
        clock.note(500.0 + k / 10, k / 10 + 0.4, k / 10 + 0.4 + UTC_OF_ZERO + step_s, k / 10 + UTC_OF_ZERO + step_s)
    assert clock.believes_the_camera
    assert clock.moment(500.0 + 3.0) == pytest.approx(3.0, abs=0.001)


def test_one_report_that_is_a_picture_off_changes_nothing() -> None:
    clock = heard([0.4] * 20, camera_off_s=0.0)
    clock.note(502.0, 2.4, 2.4 + UTC_OF_ZERO, 2.1 + UTC_OF_ZERO)
    assert clock.moment(501.0) == pytest.approx(1.0, abs=0.001)


@pytest.mark.parametrize("off_s", [-1.6e9, -90.0, -3.0, 2.0, 3600.0])
def test_a_camera_whose_clock_is_not_set_is_not_believed(off_s: float) -> None:
    clock = heard([0.2] * 20, camera_off_s=off_s)
    assert not clock.believes_the_camera
    assert clock.moment(501.0) == pytest.approx(1.0 + 0.2 - LATENCY_S, abs=0.01)


def test_a_camera_whose_quartz_is_slow_is_followed() -> None:
    """50 parts in a million, for an hour: 0.18 s if it were not."""
    clock = CaptureClock(0.0, LATENCY_S)
    for taken in np.arange(0.0, 3600.0, 1.0):
        clock.note(float(taken) * (1 - 5e-5), float(taken) + LATENCY_S, 0.0)
    assert clock.moment(3599.0 * (1 - 5e-5)) == pytest.approx(3599.0, abs=0.01)
