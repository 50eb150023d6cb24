"""A stream from a real RTSP server on loopback: the right picture is taken, whatever happens to the server."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import psutil
import pytest

from gcs_mosaic.frames.rtsp.settings import StreamSettings
from gcs_mosaic.messages import Frame, SourceReport
from sitl.stream.camera import StreamingCamera
from tests.frames.rtsp.streamed import PERIOD_S, Listened, listening, needs_gstreamer, number_in, pixels

pytestmark = needs_gstreamer

RECEIVES = "gcs_mosaic.frames.rtsp.stream_process:receive"
TRIGGERS = 300
AWAY_S = 1.6
UNTOLD_S = PERIOD_S + 0.05  # until the camera's first reports of its time, the way's length is taken from the settings


@dataclass(frozen=True)
class Flown:
    """What a flight has brought: the pictures' numbers, and the errors of the wrong ones, by trigger."""

    frames: dict[int, int]
    wrong: dict[int, float]
    report: SourceReport


def trigger_at(flight: Listened, moments: list[float]) -> None:
    for moment in moments:
        time.sleep(max(0.0, moment - time.monotonic()))
        flight.trigger(time.monotonic())


def answered(flight: Listened) -> bool:
    return len(flight.frames) == len(flight.asked)


def fly_long() -> Flown:
    """Triggers all the while; some of them are told up to a second late, as radios do it."""
    rng = np.random.default_rng(5)
    with listening(StreamingCamera()) as flight:
        time.sleep(1.0)
        moment, told = time.monotonic(), []
        for _ in range(TRIGGERS):
            moment += rng.uniform(1.1, 1.5) * PERIOD_S  # no two of them in one picture
            told.append((moment + rng.choice([0.02, 0.3, 1.0]), moment))
        for when, moment in sorted(told):
            time.sleep(max(0.0, when - time.monotonic()))
            flight.trigger(moment)
        flight.wait_until(lambda: answered(flight), "all triggers have their frames")
        return Flown(flight.frames, flight.wrong(PERIOD_S), flight.report)


@pytest.fixture(scope="module", autouse=True)
def long_flight(request: pytest.FixtureRequest) -> Iterator[Future[Flown] | None]:
    """It takes half a minute, so it is flown while the other tests run."""
    wanted = any("300_triggers" in item.name for item in request.session.items)
    with ThreadPoolExecutor(1) as pool:
        yield pool.submit(fly_long) if wanted else None


@pytest.mark.long
def test_a_server_that_is_killed_and_comes_back_otherwise_gives_the_right_frames_within_two_seconds() -> None:
    """With a password that nobody is told, and after the restart with another size of pictures."""
    with listening(StreamingCamera(user="pilot:pass-4711")) as flight:
        time.sleep(1.0)
        flight.trigger(time.monotonic())
        flight.wait_until(lambda: answered(flight), "a frame")
        flight.camera.kill()
        flight.wait_until(lambda: flight.has_said("is lost"), "the loss is said")
        flight.wait_until(lambda: flight.report.state == "lost", "the loss is reported")
        time.sleep(AWAY_S)
        flight.camera.size = (800, 608)
        flight.camera.start()
        back = time.monotonic()
        trigger_at(flight, list(back + np.arange(2.0, 4.0, 0.25)))
        flight.wait_until(lambda: answered(flight), "frames after the restart")
        assert flight.wrong(UNTOLD_S) == {}
        assert flight.has_said("is connected again after")
        assert flight.has_said("has changed its pictures to 800 x 608")
        assert flight.report.gaps == 1
        assert "pass-4711" not in repr(flight.items)
        assert "pilot" not in repr(flight.items)


@pytest.mark.long
def test_a_network_that_falls_silent_is_said_and_no_picture_from_before_is_taken_for_later_triggers() -> None:
    with listening(StreamingCamera()) as flight:
        time.sleep(1.0)
        flight.camera.freeze()
        frozen = time.monotonic()
        flight.wait_until(lambda: flight.report.state == "silent", "silence is reported")
        flight.trigger(frozen + 1.2)
        time.sleep(max(0.0, frozen + 2.0 - time.monotonic()))
        flight.camera.thaw()
        flight.wait_until(lambda: flight.report.state == "connected", "heard again")
        thawed = time.monotonic()
        trigger_at(flight, list(thawed + np.arange(1.0, 3.0, 0.25)))
        flight.wait_until(lambda: len(flight.frames) == len(flight.asked) - 1, "frames after the silence")
        flight.wait_until(lambda: flight.has_said("a trigger gets no frame"), "the trigger in the silence got none")
        assert 0 not in flight.frames
        assert flight.wrong(UNTOLD_S) == {}
        assert flight.has_said("brought nothing for")
        assert flight.report.gaps == 1


@pytest.mark.long
def test_a_slow_stream_has_no_gaps() -> None:
    with listening(StreamingCamera(rate=1), StreamSettings(gap_s=0.4)) as flight:
        flight.wait_until(lambda: flight.report.seen >= 5, "pictures come")
        assert not flight.has_said("brought nothing for")
        assert flight.report.gaps == 0
        states = [item.state for item in flight.items if isinstance(item, SourceReport) and item.seen > 2]
        assert set(states) == {"connected"}


@pytest.mark.long
def test_no_damaged_picture_is_ever_taken() -> None:
    """Over UDP that loses packets, in H.265, whose decoder does not notice."""
    settings = StreamSettings(transport="udp", every="0.2 s")
    camera = StreamingCamera(codec="h265", loss=0.004)
    with listening(camera, settings) as flight:
        flight.wait_until(lambda: flight.report.damaged > 10 and flight.report.taken > 5, "damage, and frames")
        frames = [item for item in flight.items if isinstance(item, Frame)]
    off_s = []
    for frame in frames:
        image = pixels(frame)
        number = number_in(image)
        # In grey values; a torn picture is off by 20 and more.
        assert np.abs(image.astype(int) - flight.film.picture(number)).mean() < 8
        taken = frame.modified - time.time() + time.monotonic()
        off_s.append(abs(taken - flight.film.shown[number]))
    assert np.median(off_s) <= PERIOD_S + 0.05  # single ones are held up by a busy machine


@pytest.mark.long
def test_a_blurred_picture_gives_way_to_a_sharp_neighbour() -> None:
    with listening(StreamingCamera()) as flight:
        flight.film.blurred = lambda number: number % 5 == 0
        time.sleep(1.5)
        blurred = [moment for number, moment in dict(flight.film.shown).items() if number % 5 == 0][-8:]
        for moment in blurred[-2:]:
            flight.trigger(moment)
        flight.wait_until(lambda: answered(flight), "frames")
        assert not [number for number in flight.frames.values() if number % 5 == 0]
        assert max(map(abs, flight.errors().values())) <= 0.15 + 0.05


@pytest.mark.thorough
@pytest.mark.long
def test_the_right_picture_is_taken_for_300_triggers(long_flight: Future[Flown]) -> None:
    """Within one picture at ten a second, or the nearest that there is where a busy machine has held the camera up."""
    flown = long_flight.result()
    assert len(flown.wrong) <= TRIGGERS / 100
    assert len(set(flown.frames.values())) == TRIGGERS
    assert flown.report.damaged == flown.report.gaps == 0


@pytest.mark.long
def test_a_crash_of_what_receives_costs_some_pictures_and_is_said() -> None:
    """FFmpeg runs in a process of its own."""
    with listening(StreamingCamera()) as flight:
        time.sleep(0.5)
        flight.trigger(time.monotonic())
        flight.wait_until(lambda: answered(flight), "the first trigger has its frame")
        before = flight.report
        (receiving,) = (one for one in psutil.Process().children() if RECEIVES in one.cmdline())
        os.kill(receiving.pid, signal.SIGSEGV)
        connected = sum("is connected" in text for text in flight.texts)
        flight.wait_until(
            lambda: sum("is connected" in text for text in flight.texts) > connected, "it is connected again"
        )
        time.sleep(0.5)
        flight.trigger(time.monotonic())
        flight.wait_until(lambda: answered(flight), "a trigger after it has its frame too")
        assert flight.has_said("has ended (SIGSEGV); it is started again")
        assert not flight.wrong(PERIOD_S + UNTOLD_S)
        flight.wait_until(lambda: flight.report.seen > before.seen, "pictures are counted on")
        assert flight.report.gaps > before.gaps
