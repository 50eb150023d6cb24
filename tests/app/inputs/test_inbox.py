"""The inbox of a live flight."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from gcs_mosaic.app.inputs.inbox import FILES, PICTURES, Inbox
from gcs_mosaic.app.inputs.links import ItemSource
from gcs_mosaic.messages import DroppedFrame, Frame, SourceReport
from tests.factories import frame

FAILED = SourceReport(kind="stream", name="rtsp://camera/x", state="ended")


def picture(number: int, data: bytes | None) -> Frame:
    return frame(f"{number}.jpg", size=4, data=data)


def brought(count: int, data: bytes | None) -> tuple[list[object], Inbox]:
    """What an inbox holds of so many frames that came while nobody took them."""
    inbox = Inbox(threading.Event())
    inbox.fill([ItemSource(iter([picture(number, data) for number in range(count)]), FAILED)])
    deadline = time.monotonic() + 20
    while len(inbox) < count:
        assert time.monotonic() < deadline
        time.sleep(0.01)
    return [inbox.next(0.0) for _ in range(count)], inbox


def test_frames_of_a_stream_that_nobody_takes_are_dropped_one_by_one_and_lose_their_pictures() -> None:
    items, inbox = brought(PICTURES + 3, b"jpeg")
    assert [type(item) for item in items] == [Frame] * PICTURES + [DroppedFrame] * 3
    dropped = items[-1]
    assert isinstance(dropped, DroppedFrame)
    assert dropped.frame == picture(PICTURES + 2, None)
    assert "too slow" in dropped.reason
    inbox.fill([ItemSource(iter([picture(0, b"jpeg")]), FAILED)])  # there is room again
    assert isinstance(inbox.next(20.0), Frame)


def test_frames_of_a_folder_are_never_dropped() -> None:
    items, _ = brought(PICTURES + 3, None)
    assert [type(item) for item in items] == [Frame] * (PICTURES + 3)


def test_of_a_folder_only_some_files_stay_in_memory(tmp_path: Path) -> None:
    frames = [replace(picture(number, b"jpeg"), path=tmp_path / f"{number}.jpg") for number in range(FILES + 3)]
    for one in frames:
        one.path.write_bytes(b"jpeg")
    inbox = Inbox(threading.Event())
    inbox.fill([ItemSource(iter(frames), FAILED)])
    inbox.join()
    assert [inbox.next(0.0) for _ in frames] == [*frames[:FILES], *(replace(one, data=None) for one in frames[FILES:])]


def test_until_when_everything_is_taken() -> None:
    """An event is not missing while its frame waits behind it, however long the disk took."""
    inbox = Inbox(threading.Event())
    before = time.monotonic()
    assert inbox.taken_until(before) == before
    inbox.fill([ItemSource(iter([picture(number, None) for number in range(3)]), FAILED)])
    inbox.join()
    after = time.monotonic() + 100
    assert [frame.name for frame in inbox.frames()] == ["0.jpg", "1.jpg", "2.jpg"]
    assert inbox.taken_until(after) < before
    inbox.next(0.0)
    assert before <= inbox.taken_until(after) <= time.monotonic()
    inbox.next(0.0)
    inbox.next(0.0)
    assert inbox.taken_until(after) == after
    assert inbox.frames() == []


def test_what_a_source_tells_as_it_ends_is_taken() -> None:
    """A link that has not decided yet whom to follow gives its triggers when it is stopped."""
    stop = threading.Event()
    inbox = Inbox(stop)
    stop.set()
    inbox.fill([ItemSource(iter([picture(0, None)]), FAILED)])
    inbox.join()
    assert inbox.next(0.0) == picture(0, None)


def test_a_flood_does_not_delay_the_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nobody takes anything any more then."""
    monkeypatch.setattr("gcs_mosaic.app.inputs.inbox.ROOM", 2)
    stop, ended = threading.Event(), threading.Event()

    def flood() -> Iterator[Frame]:
        yield from (picture(number, None) for number in range(100))
        ended.set()

    inbox = Inbox(stop)
    stop.set()
    inbox.fill([ItemSource(flood(), FAILED)])
    inbox.join()
    assert ended.is_set()
    assert len(inbox) == 2


def test_sources_that_hang_are_waited_for_together(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gcs_mosaic.app.inputs.inbox.STOP_S", 0.3)
    stop, done = threading.Event(), threading.Event()

    def hanging() -> Iterator[Frame]:
        done.wait(30.0)
        yield from ()

    inbox = Inbox(stop)
    stop.set()
    inbox.fill([ItemSource(hanging(), FAILED) for _ in range(10)])
    began = time.monotonic()
    inbox.join()
    took_s = time.monotonic() - began
    done.set()
    assert took_s < 1.5
