"""What links bring, as requests to a stream."""

from __future__ import annotations

from dataclasses import replace

from gcs_mosaic.app.stream_requests import asking
from gcs_mosaic.frames.rtsp.frame_selection import Ask
from gcs_mosaic.frames.rtsp.requests import Offer, Requests
from gcs_mosaic.messages import CaptureResult, Notice, Source, StreamOffer
from gcs_mosaic.triggers.shots import CameraMessage, Shots, ShotSettings
from tests.factories import trigger_event

EVENT = trigger_event(7, 100.2, source_time=50.0, clock="boot")
LATER = replace(EVENT, sequence=8, received=104.9, source_time=54.0)


def asked(*items: object) -> list[Ask | Offer]:
    requests = Requests()
    passed_on = list(asking(Shots(ShotSettings()).follow(iter(items)), requests))
    assert [item.event if isinstance(item, CameraMessage) else item for item in passed_on] == list(items)
    return list(requests.drain())


def test_a_picture_is_asked_for_of_the_moment_at_which_the_shot_was_taken() -> None:
    """The second message took 0.7 s longer than the first."""
    first, second = asked(EVENT, Notice(source="", level="info", text=""), LATER)
    assert first == Ask(100.2, EVENT)
    assert isinstance(second, Ask)
    assert abs(second.moment - 104.2) < 0.01


def test_messages_about_one_shot_ask_once() -> None:
    witness = replace(EVENT, source=Source.IMAGE_CAPTURED_BY_CAMERA, received=100.6, component=100)
    assert len(asked(EVENT, EVENT, witness)) == 1


def test_a_shot_that_failed_asks_for_nothing() -> None:
    assert asked(replace(EVENT, result=CaptureResult.FAILED)) == []


def test_where_the_aircraft_says_that_its_stream_is_is_passed_on() -> None:
    assert asked(StreamOffer(vehicle=1, url="rtsp://camera/x")) == [Offer("rtsp://camera/x")]


def test_requests_of_a_stream_that_hangs_do_not_fill_the_memory() -> None:
    requests = Requests()
    assert sum(requests.put(Ask(0.0)) for _ in range(5000)) == len(list(requests.drain())) < 5000
