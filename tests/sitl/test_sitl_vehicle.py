from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import closing
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.geometry import CameraState
from sitl.messages import AUTOPILOT, MANNERS, Capture, Moment, attitude, px4
from sitl.vehicle import BOOTED_BEFORE, Faults, Vehicle
from tests.sitl.sitl_parts import Ground

STATE = CameraState(time=0, x=100, y=-200, height=80, yaw=-0.5, pitch=0.02, roll=0.01)


@pytest.fixture
def ground() -> Iterator[Ground]:
    with closing(Ground()) as station:
        yield station


def told(
    ground: Ground, index: int, *manners: str, state: CameraState | None = STATE, name: str = "DCIM/a.JPG"
) -> list[Any]:
    vehicle = Vehicle("127.0.0.1", ground.port, manners)
    vehicle.capture(Capture(index=index, name=name, state=state))
    vehicle.close()
    return ground.heard()


def test_px4_tells_of_the_trigger_and_then_of_the_capture(ground: Ground) -> None:
    trigger, captured = told(ground, 7, "px4")
    assert trigger.get_type() == "CAMERA_TRIGGER"
    assert trigger.seq == 7
    assert trigger.time_usec / 1e6 == pytest.approx(BOOTED_BEFORE, abs=5)
    assert captured.get_type() == "CAMERA_IMAGE_CAPTURED"
    assert captured.image_index == 7
    assert (captured.camera_id, captured.file_url, captured.capture_result) == (1, "", -1)
    assert captured.time_boot_ms * 1000 == pytest.approx(trigger.time_usec, abs=1000)
    assert captured.time_utc / 1e6 == pytest.approx(time.time(), abs=5)


def test_ardupilot_gives_feedback_whose_index_wraps(ground: Ground) -> None:
    (feedback,) = told(ground, 2**16 + 5, "ardupilot")
    assert feedback.get_type() == "CAMERA_FEEDBACK"
    assert feedback.img_idx == 5
    assert feedback.time_usec / 1e6 == pytest.approx(time.time(), abs=5)
    assert feedback.alt_rel == pytest.approx(80)
    assert feedback.alt_msl > 400
    assert feedback.yaw == pytest.approx(360 - np.degrees(0.5), abs=1e-3)
    assert feedback.get_srcComponent() == AUTOPILOT


def test_a_camera_names_its_file(ground: Ground) -> None:
    (captured,) = told(ground, 3, "camera", name="DCIM/100MEDIA/IMG_0003.JPG")
    assert captured.get_srcComponent() == 100
    assert captured.camera_id == 0
    assert captured.file_url.endswith("/100MEDIA/IMG_0003.JPG")
    assert captured.capture_result == 1


def test_a_name_too_long_for_the_message_is_not_cut(ground: Ground) -> None:
    (captured,) = told(ground, 3, "camera", name="ü" * 150 + ".JPG")
    assert captured.file_url == ""


def test_manners_combine_and_all_speak_mavlink_2_as_system_1(ground: Ground) -> None:
    messages = told(ground, 1, *MANNERS)
    assert [message.get_msgId() for message in messages] == [112, 263, 180, 263]
    assert {message.get_srcSystem() for message in messages} == {1}
    assert all(message.get_msgbuf()[0] == 0xFD for message in messages)


def test_sequence_numbers_run_without_a_gap(ground: Ground) -> None:
    messages = told(ground, 1, "px4", "ardupilot")
    assert [message.get_seq() for message in messages] == [0, 1, 2]


def test_without_a_state_no_position_is_made_up(ground: Ground) -> None:
    messages = told(ground, 1, "px4", "ardupilot", state=None)
    assert (messages[1].lat, messages[1].lon, messages[2].lat, messages[2].lng) == (0, 0, 0, 0)


def test_metres_become_degrees_north_and_east(ground: Ground) -> None:
    (here,) = told(ground, 1, "ardupilot", state=CameraState(time=0, x=0, y=0, height=80))
    (there,) = told(ground, 1, "ardupilot")
    north, east = (there.lat - here.lat) * 1e-7, (there.lng - here.lng) * 1e-7
    assert np.radians(north) * 6_378_137 == pytest.approx(200, rel=0.01)
    assert np.radians(east) * 6_378_137 * np.cos(np.radians(47.4)) == pytest.approx(100, rel=0.01)


@pytest.mark.long
def test_telemetry_comes_at_its_pace(ground: Ground) -> None:
    vehicle = Vehicle("127.0.0.1", ground.port, ["camera"])
    until = time.monotonic() + 1.3
    while time.monotonic() < until:
        vehicle.tick(STATE)
        time.sleep(0.02)
    vehicle.close()
    kinds = [(message.get_type(), message.get_srcComponent()) for message in ground.heard()]
    assert kinds.count(("HEARTBEAT", 1)) == kinds.count(("HEARTBEAT", 100)) == kinds.count(("SYSTEM_TIME", 1)) == 2
    assert 3 <= kinds.count(("GLOBAL_POSITION_INT", 1)) <= 6


def test_system_time_joins_the_two_clocks(ground: Ground) -> None:
    vehicle = Vehicle("127.0.0.1", ground.port)
    vehicle.tick(None)
    vehicle.close()
    beat, clock = ground.heard()
    assert beat.autopilot == mavlink.MAV_AUTOPILOT_PX4
    assert beat.type == mavlink.MAV_TYPE_QUADROTOR
    assert clock.time_unix_usec / 1e6 == pytest.approx(time.time(), abs=5)
    assert clock.time_boot_ms / 1e3 == pytest.approx(BOOTED_BEFORE, abs=5)


def test_nobody_listening_is_no_error() -> None:
    station = Ground()
    station.close()
    vehicle = Vehicle("127.0.0.1", station.port)
    for index in range(3):
        vehicle.capture(Capture(index=index, name="a", state=None))
    vehicle.close()


def test_unknown_manners_are_refused() -> None:
    with pytest.raises(ValueError, match="px4, ardupilot, camera, not dji"):
        Vehicle("127.0.0.1", 14550, ["dji"])


def test_the_quaternion_turns_as_the_angles_do() -> None:
    w, x, y, z = attitude(CameraState(time=0, x=0, y=0, height=1, yaw=0.7, pitch=0.2, roll=-0.3))
    assert w * w + x * x + y * y + z * z == pytest.approx(1)
    assert np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)) == pytest.approx(0.7)
    assert np.arcsin(2 * (w * y - z * x)) == pytest.approx(0.2)
    assert np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)) == pytest.approx(-0.3)


def through(faults: Faults, count: int = 1000) -> list[int]:
    """What becomes of messages 0, 1, 2, … on a bad link."""
    passed = [message for k in range(count) for message in faults.passed([(1, k)])]
    return [int(message[1]) for message in [*passed, *faults.held]]


def test_a_good_link_changes_nothing() -> None:
    assert through(Faults()) == list(range(1000))


def test_a_bad_link_drops_and_doubles_its_shares() -> None:
    assert len(through(Faults(drop=0.2))) == pytest.approx(800, abs=40)
    doubled = through(Faults(duplicate=0.3))
    assert len(doubled) == pytest.approx(1300, abs=50)
    assert sorted(set(doubled)) == list(range(1000))


def test_reordering_loses_nothing_and_moves_neighbours() -> None:
    order = through(Faults(reorder=0.2))
    assert sorted(order) == list(range(1000))
    assert order != sorted(order)
    assert max(abs(k - message) for k, message in enumerate(order)) == 1


def test_faults_repeat_with_their_seed() -> None:
    faults = [Faults(drop=0.2, duplicate=0.1, reorder=0.1, seed=seed) for seed in (1, 1, 2)]
    first, again, other = (through(fault) for fault in faults)
    assert first == again != other


def test_messages_need_no_clock_of_their_own() -> None:
    moment = Moment(boot=12.5, utc=1_700_000_000.25)
    (_, trigger), (_, captured) = px4(Capture(index=1, name="a", state=STATE), moment)
    assert trigger.time_usec == 12_500_000
    assert captured.time_utc == 1_700_000_000_250_000
