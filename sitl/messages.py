"""Builds the vehicle's pymavlink messages in the manner of PX4, ArduPilot and a MAVLink camera. Pure: no socket, no clock."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from .geometry import CameraState

AUTOPILOT, CAMERA = 1, 100  # MAVLink component ids
ORIGIN = (47.3977, 8.5456, 488.0)  # degrees and metres: PX4 SITL's default home (Zurich)
METRES_PER_DEGREE = 111_320.0
LONGEST_URL = 200  # bytes; the message field has 205
FULL_TURN = 360.0

Sent = tuple[int, Any]  # component id, message


@dataclass(frozen=True, slots=True, kw_only=True)
class Moment:
    """The vehicle's clocks at one instant: seconds since boot, and since 1970."""

    boot: float
    utc: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Capture:
    """One picture taken. index: the camera's image index; state: None for recorded frames without a position."""

    index: int
    name: str
    state: CameraState | None


def position(state: CameraState | None) -> tuple[int, int, float, float]:
    """Latitude and longitude in 1e-7 degrees, altitude above sea level and above ground in metres; zeros if unknown."""
    if state is None:
        return 0, 0, 0.0, 0.0
    latitude = ORIGIN[0] - state.y / METRES_PER_DEGREE
    longitude = wrapped(ORIGIN[1] + state.x / (METRES_PER_DEGREE * np.cos(np.radians(ORIGIN[0]))))
    return round(latitude * 1e7), round(longitude * 1e7), ORIGIN[2] + state.height, state.height


def state_at(time: float, latitude: float, longitude: float, altitude: float) -> CameraState:
    """Of a camera whose place alone is known; `position` tells that place again."""
    x = wrapped(longitude - ORIGIN[1]) * METRES_PER_DEGREE * float(np.cos(np.radians(ORIGIN[0])))
    return CameraState(time=time, x=x, y=(ORIGIN[0] - latitude) * METRES_PER_DEGREE, height=altitude - ORIGIN[2])


def wrapped(degrees: float) -> float:
    return (degrees + FULL_TURN / 2) % FULL_TURN - FULL_TURN / 2


def attitude(state: CameraState) -> list[float]:
    """Quaternion (w, x, y, z) of yaw, pitch, roll."""
    (cy, cp, cr), (sy, sp, sr) = (
        trig(np.array([state.yaw, state.pitch, state.roll]) / 2).tolist() for trig in (np.cos, np.sin)
    )
    return [
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    ]


def px4(capture: Capture, moment: Moment) -> Iterator[Sent]:
    """CAMERA_TRIGGER, and the autopilot's CAMERA_IMAGE_CAPTURED without a URL and with an unknown result."""
    yield AUTOPILOT, mavlink.MAVLink_camera_trigger_message(micros(moment.boot), capture.index)
    yield AUTOPILOT, image_captured(capture, moment, camera_id=1, result=-1, url="")


def ardupilot(capture: Capture, moment: Moment) -> Iterator[Sent]:
    """CAMERA_FEEDBACK as sent without a feedback pin: epoch time, and a 16-bit index that wraps."""
    latitude, longitude, over_sea, over_ground = position(capture.state)
    at = capture.state or CameraState(time=0, x=0, y=0, height=0)
    roll, pitch, yaw = np.degrees([at.roll, at.pitch, at.yaw]).tolist()
    yield (
        AUTOPILOT,
        mavlink.MAVLink_camera_feedback_message(
            time_usec=micros(moment.utc),
            target_system=0,
            cam_idx=0,
            img_idx=capture.index % 2**16,
            lat=latitude,
            lng=longitude,
            alt_msl=over_sea,
            alt_rel=over_ground,
            roll=roll,
            pitch=pitch,
            yaw=yaw % FULL_TURN,
            foc_len=0.0,
            flags=mavlink.CAMERA_FEEDBACK_PHOTO,
            completed_captures=capture.index % 2**16,
        ),
    )


def camera(capture: Capture, moment: Moment) -> Iterator[Sent]:
    """CAMERA_IMAGE_CAPTURED of a MAVLink camera, which names the file."""
    url = f"mftp://{capture.name}"
    url = url if len(url.encode()) <= LONGEST_URL else ""
    yield CAMERA, image_captured(capture, moment, camera_id=0, result=1, url=url)


Manner = Callable[[Capture, Moment], Iterator[Sent]]
MANNERS: dict[str, Manner] = {"px4": px4, "ardupilot": ardupilot, "camera": camera}


def image_captured(capture: Capture, moment: Moment, *, camera_id: int, result: int, url: str) -> Any:
    latitude, longitude, over_sea, over_ground = position(capture.state)
    return mavlink.MAVLink_camera_image_captured_message(
        time_boot_ms=millis(moment.boot),
        time_utc=micros(moment.utc),
        camera_id=camera_id,
        lat=latitude,
        lon=longitude,
        alt=round(over_sea * 1000),
        relative_alt=round(over_ground * 1000),
        q=attitude(capture.state) if capture.state else [1.0, 0.0, 0.0, 0.0],
        image_index=capture.index,
        capture_result=result,
        file_url=url.encode(),
    )


def heartbeats(manners: tuple[str, ...]) -> Iterator[Sent]:
    """HEARTBEAT of the autopilot, and of the camera if it is a MAVLink component."""
    ardupilot_flies = "px4" not in manners
    autopilot = mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA if ardupilot_flies else mavlink.MAV_AUTOPILOT_PX4
    armed = mavlink.MAV_MODE_FLAG_SAFETY_ARMED | mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
    active, none = mavlink.MAV_STATE_ACTIVE, mavlink.MAV_AUTOPILOT_INVALID
    yield AUTOPILOT, mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_QUADROTOR, autopilot, armed, 0, active, 3)
    if "camera" in manners:
        yield CAMERA, mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_CAMERA, none, 0, 0, active, 3)


def system_time(moment: Moment) -> Sent:
    return AUTOPILOT, mavlink.MAVLink_system_time_message(micros(moment.utc), millis(moment.boot))


def global_position(state: CameraState, moment: Moment) -> Sent:
    latitude, longitude, over_sea, over_ground = position(state)
    heading = round(np.degrees(state.yaw) % FULL_TURN * 100) % 36_000
    heights = (round(over_sea * 1000), round(over_ground * 1000))
    message = mavlink.MAVLink_global_position_int_message(
        millis(moment.boot), latitude, longitude, *heights, 0, 0, 0, heading
    )
    return AUTOPILOT, message


def micros(seconds: float) -> int:
    return round(seconds * 1e6)


def millis(seconds: float) -> int:
    return round(seconds * 1e3)
