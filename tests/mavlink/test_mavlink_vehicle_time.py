from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_mosaic.mavlink.messages import decode
from gcs_mosaic.mavlink.parser import dialect
from gcs_mosaic.mavlink.vehicle_time import VehicleTimes
from gcs_mosaic.messages import TriggerEvent
from tests.mavlink.mavlink_peer import captured, feedback, received, trigger
from tests.sure import sure

UTC = 1_750_000_000.0
YEAR_S = 365.25 * 86400


def system_time(utc: float, boot: float, system: int = 1, component: int = 1) -> Any:
    message = dialect.MAVLink_system_time_message(round(utc * 1e6), round(boot * 1e3))
    return received(message, system, component)


def event(message: Any, at: float, system: int = 1, component: int = 1) -> TriggerEvent:
    return sure(decode(received(message, system, component), at))


def dated(*heard: tuple[Any, float], message: Any = None, at: float = 60.0, component: int = 1) -> float | None:
    times = VehicleTimes()
    for told, moment in heard:
        times.hear(told, moment)
    return times.dated(event(message or trigger(1, time_usec=150_000_000), at, component=component)).utc


def test_a_trigger_since_boot_gets_the_date_of_its_vehicle() -> None:
    assert dated((system_time(UTC, 100.0), 10.0)) == UTC + 50.0


def test_without_system_time_nothing_is_dated() -> None:
    assert dated() is None


@pytest.mark.parametrize("utc", [0.0, 938 * YEAR_S, 10 * YEAR_S, 2**63 / 1e6])
def test_an_absurd_year_is_not_believed(utc: float) -> None:
    assert dated((system_time(utc, 100.0), 10.0)) is None


def test_an_absurd_year_after_a_good_one_changes_nothing() -> None:
    assert dated((system_time(UTC, 100.0), 10.0), (system_time(0.0, 101.0), 11.0)) == UTC + 50.0


def test_after_a_reboot_the_old_date_is_forgotten() -> None:
    assert dated((system_time(UTC, 100.0), 10.0), (system_time(0.0, 2.0), 40.0)) is None
    again = (system_time(UTC + 34, 6.0), 44.0)
    assert dated((system_time(UTC, 100.0), 10.0), (system_time(0.0, 2.0), 40.0), again) == UTC + 34 + 144


def test_a_date_of_its_own_is_left_as_it_is() -> None:
    own = captured(1, time_boot_ms=150_000, time_utc=round((UTC + 9) * 1e6))
    assert dated((system_time(UTC, 100.0), 10.0), message=own) == UTC + 9


def test_another_component_boots_for_itself() -> None:
    assert dated((system_time(UTC, 100.0), 10.0), component=100) is None


@given(st.floats(0, 50_000), st.floats(0, 30))
def test_feedback_is_dated_across_the_wrap(boot: float, since: float) -> None:
    """ArduPilot counts the microseconds of CAMERA_FEEDBACK in 32 bits, those of SYSTEM_TIME go on."""
    wrapped = round((boot + since) * 1e6) % 2**32
    if wrapped == 0:
        return
    utc = dated((system_time(UTC, boot), 10.0), message=feedback(1, time_usec=wrapped), at=10.0 + since)
    assert utc == pytest.approx(UTC + since, abs=0.002)


def test_a_forger_with_many_names_is_not_remembered_for_ever() -> None:
    times = VehicleTimes()
    for system in range(1, 255):
        times.hear(system_time(UTC, 100.0, system=system), 1.0)
    assert len(times._senders) == 32
