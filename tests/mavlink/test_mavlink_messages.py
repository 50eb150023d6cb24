from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs_mosaic.mavlink.messages import base_name, decode, decode_offer, named_file
from gcs_mosaic.messages import CaptureResult, Position, Source, TriggerEvent
from tests.mavlink.mavlink_peer import captured, feedback, heartbeat, received, trigger


def event_of(message: Any, component: int = 1) -> TriggerEvent:
    event = decode(received(message, system=7, component=component), 12.5)
    assert event is not None
    return event


def test_camera_trigger_counts_from_boot() -> None:
    event = event_of(trigger(41, time_usec=90_500_000))
    assert (event.vehicle, event.source, event.sequence, event.received) == (7, Source.CAMERA_TRIGGER, 41, 12.5)
    assert (event.clock, event.source_time, event.utc) == ("boot", 90.5, None)
    assert event.result is CaptureResult.UNKNOWN


def test_camera_feedback_counts_from_1970_without_a_pin() -> None:
    event = event_of(feedback(65535, time_usec=1_750_000_000_250_000, lat=471234567, lng=85432100, alt_msl=560.5))
    assert (event.clock, event.utc, event.sequence) == ("epoch", 1_750_000_000.25, 65535)
    assert event.position == Position(latitude_deg=47.1234567, longitude_deg=8.54321, altitude_m=560.5)


def test_camera_feedback_of_a_video_is_no_shot() -> None:
    assert decode(received(feedback(1, flags=1)), 0.0) is None


@pytest.mark.parametrize(("flags", "result"), [(0, "unknown"), (3, "taken"), (4, "unknown")])
def test_camera_feedback_is_certain_only_with_a_pin(flags: int, result: str) -> None:
    assert event_of(feedback(1, flags=flags)).result.value == result


def test_image_captured_names_its_file() -> None:
    url = b"http://10.0.0.5/DCIM/100MEDIA/IMG_0042.JPG?token=1#x"
    event = event_of(captured(42, time_boot_ms=60_250, time_utc=1_750_000_000_000_000, file_url=url), component=100)
    assert (event.source, event.file_hint) == (Source.IMAGE_CAPTURED_BY_CAMERA, "100MEDIA/IMG_0042.JPG")
    assert (event.clock, event.source_time, event.utc) == ("boot", 60.25, 1_750_000_000.0)


def test_image_captured_by_the_autopilot_is_the_lesser_witness() -> None:
    assert event_of(captured(1)).source < event_of(captured(1), component=100).source


@pytest.mark.parametrize(("value", "result"), [(1, "taken"), (0, "failed"), (-1, "unknown"), (7, "unknown")])
def test_image_captured_says_how_it_went(value: int, result: str) -> None:
    assert event_of(captured(1, capture_result=value)).result.value == result


def test_an_index_below_zero_is_no_index() -> None:
    assert event_of(captured(-1)).sequence is None


@pytest.mark.parametrize("altitude", [math.nan, math.inf, -1e30])
def test_an_absurd_altitude_is_left_out(altitude: float) -> None:
    position = event_of(feedback(1, lat=471234567, lng=85432100, alt_msl=altitude)).position
    assert position is not None
    assert position.altitude_m is None


@pytest.mark.parametrize(("latitude", "longitude"), [(0, 0), (2**31 - 1, 85432100), (471234567, -(2**31))])
def test_an_absurd_position_is_none(latitude: int, longitude: int) -> None:
    assert event_of(feedback(1, lat=latitude, lng=longitude)).position is None


def test_other_messages_are_no_events() -> None:
    assert decode(received(heartbeat()), 0.0) is None


@pytest.mark.parametrize(
    ("kind", "uri", "told"),
    [
        (0, b"rtsp://10.0.0.7/main", "rtsp://10.0.0.7/main"),
        (0, b"", None),
        (1, b"5600", None),  # RTP over UDP
    ],
)
def test_where_an_rtsp_stream_is_is_told(kind: int, uri: bytes, told: str | None) -> None:
    numbers = {"framerate": 10.0, "resolution_h": 640, "resolution_v": 480, "bitrate": 0, "rotation": 0, "hfov": 0}
    message = mavlink.MAVLink_video_stream_information_message(
        stream_id=1, count=1, type=kind, flags=1, name=b"main", uri=uri, **numbers
    )
    offer = decode_offer(received(message, system=7))
    assert (offer and offer.url) == told
    assert offer is None or (offer.vehicle == 7 and "10.0.0.7" not in repr(offer))
    assert decode_offer(received(heartbeat())) is None


@pytest.mark.parametrize(
    ("url", "name"),
    [
        ("IMG_1.JPG", "IMG_1.JPG"),
        ("mftp:///fs/microsd/IMG%201.JPG", "IMG 1.JPG"),
        (r"C:\DCIM\IMG_1.JPG", "IMG_1.JPG"),
        ("../../etc/passwd", "passwd"),
        ("x/%2e%2e%2fetc%2fshadow", "shadow"),
        ("x/IMG\x1b[31m_1\u202e.JPG", "IMG[31m_1.JPG"),
        ("", None), ("/", None), ("..", None), ("x/...", None), ("%00", None), ("a" * 129, None),
    ],
)  # fmt: skip
def test_only_a_base_name_is_left_of_a_url(url: str, name: str | None) -> None:
    assert base_name(url) == name


@pytest.mark.parametrize(
    ("url", "name"),
    [
        ("IMG_1.JPG", "IMG_1.JPG"),
        ("mftp://IMG_1.JPG", "IMG_1.JPG"),
        ("mftp:///fs/DCIM/101MEDIA/IMG_1.JPG", "101MEDIA/IMG_1.JPG"),
        (r"D:\DCIM\101MEDIA\IMG_1.JPG", "101MEDIA/IMG_1.JPG"),
        ("../../IMG_1.JPG", "IMG_1.JPG"),
        ("%2e%2e/x%2f\x1bIMG_1.JPG", "x/IMG_1.JPG"),
        ("DCIM/101MEDIA/", None), ("a" * 120 + "/IMG_1.JPG", "IMG_1.JPG"),
    ],
)  # fmt: skip
def test_a_file_is_named_with_its_folder(url: str, name: str | None) -> None:
    assert named_file(url) == name


@given(st.text(max_size=300))
def test_a_base_name_never_leads_anywhere(url: str) -> None:
    name, named = base_name(url), named_file(url) or ""
    assert len(named) <= 128
    assert named.rpartition("/")[2] == (name or "")
    assert name is None or 0 < len(name) <= 128
    assert name is None or (not set(name) & set("/\\\0\n\r\x1b\u202e\u2028") and name.strip(".") != "")
