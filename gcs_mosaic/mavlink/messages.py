"""MAVLink camera messages (112, 180, 263) -> TriggerEvent. Pure; every field is hostile until checked.

Field meanings: the MAVLink definitions common.xml and ardupilotmega.xml.
"""

from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Callable
from dataclasses import replace
from typing import Any, TypeAlias
from urllib.parse import unquote

from gcs_mosaic.mavlink.clock import clock_of, plausible_utc
from gcs_mosaic.messages import CaptureResult, Position, Source, StreamOffer, TriggerEvent

MavMessage: TypeAlias = Any  # an instance of one of pymavlink's generated classes

AUTOPILOT_COMPONENT = 1  # MAV_COMP_ID_AUTOPILOT1
CAMERA_FEEDBACK_VIDEO = 1
CAMERA_FEEDBACK_CLOSEDLOOP = 3
STREAM_RTSP = 0  # VIDEO_STREAM_TYPE_RTSP
LONGEST_URL = 160  # characters, as the message has them
LONGEST_NAME = 128  # characters of a file name that are worth keeping
HIGHEST_M = 100_000.0

_RESULTS = {1: CaptureResult.TAKEN, 0: CaptureResult.FAILED}


def decode(message: MavMessage, received: float) -> TriggerEvent | None:
    """The event in a camera message that came at `received` (monotonic seconds); None if it announces no picture."""
    read = _READERS.get(message.get_type())
    return read(message, received) if read else None


def decode_offer(message: MavMessage) -> StreamOffer | None:
    """The RTSP stream that a VIDEO_STREAM_INFORMATION (message 269) tells of."""
    if message.get_type() != "VIDEO_STREAM_INFORMATION" or message.type != STREAM_RTSP or not message.uri:
        return None
    return StreamOffer(vehicle=message.get_srcSystem(), url=str(message.uri)[:LONGEST_URL])


def base_name(url: str) -> str | None:
    """The last part of a URL or of a path of any system, safe to look up inside one folder; None if there is none."""
    last = re.split(r"[/\\]", unquote(re.split(r"[?#]", url)[0]))[-1]
    printable = "".join(letter for letter in last if not _is_control(letter)).strip()
    return printable if printable.strip(".") and len(printable) <= LONGEST_NAME else None


def _is_control(letter: str) -> bool:
    return unicodedata.category(letter) in ("Zl", "Zp") or unicodedata.category(letter).startswith("C")


def _camera_trigger(message: MavMessage, received: float) -> TriggerEvent:
    return replace(_heard(message, received, Source.CAMERA_TRIGGER, message.time_usec / 1e6), sequence=message.seq)


def _camera_feedback(message: MavMessage, received: float) -> TriggerEvent | None:
    if message.flags == CAMERA_FEEDBACK_VIDEO:
        return None
    # Without a feedback pin the autopilot only knows that it asked for a picture.
    confirmed = message.flags == CAMERA_FEEDBACK_CLOSEDLOOP
    return replace(
        _heard(message, received, Source.CAMERA_FEEDBACK, message.time_usec / 1e6),
        camera=message.cam_idx,
        sequence=message.img_idx,
        result=CaptureResult.TAKEN if confirmed else CaptureResult.UNKNOWN,
        position=_position(message.lat, message.lng, message.alt_msl),
    )


def _camera_image_captured(message: MavMessage, received: float) -> TriggerEvent:
    by_autopilot = message.get_srcComponent() == AUTOPILOT_COMPONENT
    source = Source.IMAGE_CAPTURED_BY_AUTOPILOT if by_autopilot else Source.IMAGE_CAPTURED_BY_CAMERA
    return replace(
        _heard(message, received, source, message.time_boot_ms / 1e3 or message.time_utc / 1e6),
        camera=message.camera_id,
        sequence=message.image_index if message.image_index >= 0 else None,
        utc=plausible_utc(message.time_utc / 1e6),
        result=_RESULTS.get(message.capture_result, CaptureResult.UNKNOWN),
        file_hint=base_name(message.file_url),
        position=_position(message.lat, message.lon, message.alt / 1e3),
    )


def _heard(message: MavMessage, received: float, source: Source, seconds: float) -> TriggerEvent:
    clock = clock_of(seconds)
    return TriggerEvent(
        vehicle=message.get_srcSystem(),
        component=message.get_srcComponent(),
        camera=0,
        source=source,
        sequence=None,
        received=received,
        source_time=None if clock == "none" else seconds,
        clock=clock,
        utc=plausible_utc(seconds),
        result=CaptureResult.UNKNOWN,
        file_hint=None,
        position=None,
    )


def _position(latitude_e7: int, longitude_e7: int, altitude_m: float) -> Position | None:
    latitude, longitude = latitude_e7 / 1e7, longitude_e7 / 1e7
    if (latitude, longitude) == (0, 0) or abs(latitude) > 90 or abs(longitude) > 180:
        return None
    sane = math.isfinite(altitude_m) and abs(altitude_m) <= HIGHEST_M
    return Position(latitude_deg=latitude, longitude_deg=longitude, altitude_m=altitude_m if sane else None)


_READERS: dict[str, Callable[[MavMessage, float], TriggerEvent | None]] = {
    "CAMERA_TRIGGER": _camera_trigger,
    "CAMERA_FEEDBACK": _camera_feedback,
    "CAMERA_IMAGE_CAPTURED": _camera_image_captured,
}
