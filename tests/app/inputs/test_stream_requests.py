"""What links bring, as requests to a stream."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import replace

from gcs_mosaic.app.inputs.inbox import asking
from gcs_mosaic.frames.rtsp import source
from gcs_mosaic.frames.rtsp.address import AUTO, parse_stream
from gcs_mosaic.frames.rtsp.frame_selection import Ask
from gcs_mosaic.frames.rtsp.receiver import Receiver
from gcs_mosaic.frames.rtsp.requests import Offer, Requests
from gcs_mosaic.frames.rtsp.ring_buffer import Ring
from gcs_mosaic.frames.rtsp.settings import StreamSettings
from gcs_mosaic.mavlink.flood import Trust
from gcs_mosaic.messages import CaptureResult, Notice, Source, StreamOffer, Teller
from gcs_mosaic.triggers.shots import CameraMessage, Shots, ShotSettings
from tests.factories import trigger_event

EVENT = trigger_event(7, 100.2, source_time=50.0, clock="boot")
LATER = replace(EVENT, sequence=8, received=104.9, source_time=54.0)


def asked(*items: object, trusted: Sequence[Teller] = ()) -> list[Ask | Offer]:
    requests, trust = Requests(), Trust()
    trust.sources = frozenset(trusted)
    passed_on = list(asking(Shots(ShotSettings()).follow(iter(items)), requests, trust))
    assert [item.event if isinstance(item, CameraMessage) else item for item in passed_on] == list(items)
    return list(requests.drain())


def test_a_picture_is_asked_for_of_the_moment_at_which_the_shot_was_taken() -> None:
    """The second message took 0.7 s longer than the first."""
    first, second = asked(EVENT, Notice(source="", level="info", text=""), LATER)
    assert first == Ask(100.2, EVENT)
    assert isinstance(second, Ask)
    assert abs(second.moment - 104.2) < 0.01


def test_whose_shots_have_proved_true_is_told() -> None:
    assert asked(EVENT, trusted=[EVENT.teller]) == [Ask(100.2, EVENT, is_trusted=True)]


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


def told(address: str, *urls: str) -> list[str]:
    """What is said of streams that somebody on the link offers."""
    stop = threading.Event()
    settings = StreamSettings(allowed_hosts=("127.0.0.1",))
    given = None if address == AUTO else parse_stream(address)
    listening = source.Stream(given, Receiver(Ring(1.0, 1 << 20), settings, stop), Requests(), settings)
    return [notice.text for url in urls for notice in listening.hear(Offer(url))]


def test_streams_that_are_offered_again_and_again_are_not_said_again_and_again() -> None:
    forged = [f"rtsp://192.0.2.{k % 200}/x" for k in range(5000)]
    assert len(told(AUTO, *forged)) <= 8


def test_an_address_that_the_operator_gave_stays() -> None:
    assert told("rtsp://127.0.0.1:1/mine", "rtsp://127.0.0.1:2/other") == []
    assert told(AUTO, "rtsp://127.0.0.1:2/other") == ["the aircraft's stream is rtsp://127.0.0.1:2/other"]


def test_streams_are_not_changed_all_the_time() -> None:
    assert len(told(AUTO, *(f"rtsp://127.0.0.1:{port}/x" for port in range(2, 50)))) == 1
