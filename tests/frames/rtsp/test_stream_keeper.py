"""What comes from the process that receives a stream is checked: a camera may have taken it over."""

from __future__ import annotations

import json
import math
import multiprocessing
import threading
from collections.abc import Callable
from multiprocessing.connection import Connection

import pytest

from gcs_mosaic.frames.rtsp import keeper
from gcs_mosaic.frames.rtsp.frame_selection import Ask
from gcs_mosaic.frames.rtsp.keeper import stream
from gcs_mosaic.frames.rtsp.requests import Offer, Requests
from gcs_mosaic.frames.rtsp.source import Item
from gcs_mosaic.messages import Frame, Notice, SourceReport, content_hash
from gcs_mosaic.processes import keeper as pauses
from gcs_mosaic.processes.pipe import END
from tests.factories import trigger_event

URL = "rtsp://127.0.0.1:9/x"
JPEG = b"\xff\xd8 and so on"
NAME = "stream/20261124-101112.500.jpg"
REPORT = {"name": URL, "state": "connected", "since_utc": 1.0, "last_seen_utc": 2.0, "same_since_utc": None}
COUNTS = {"seen": 5, "taken": 2, "damaged": 1, "gaps": 0}
SAID = "the process that receives the stream has ended (exit code 0); it is started again"


class Told:
    """A process that sends what a test has it send, and then ends."""

    def __init__(self, tell: Callable[[Connection], None]) -> None:
        self.pipe, self.theirs = multiprocessing.Pipe()
        self._thread = threading.Thread(target=self._run, args=(tell,))
        self._thread.start()

    def _run(self, tell: Callable[[Connection], None]) -> None:
        try:
            tell(self.theirs)
        except OSError:
            return  # nobody listens any more
        finally:
            self.theirs.close()

    def end(self) -> int:
        self.pipe.close()
        self._thread.join()
        return 0


def items_of(monkeypatch: pytest.MonkeyPatch, *lives: Callable[[Connection], None], ask: bool = False) -> list[Item]:
    """What the program sees of processes that end one after the other."""
    stop, requests, left = threading.Event(), Requests(), list(lives)
    if ask:
        requests.put(Ask(3.0, trigger_event(7, 3.0)))

    def started(_: object) -> Told:
        if len(left) == 1:
            threading.Timer(0.5, stop.set).start()
        return Told(left.pop(0) if left else lambda pipe: None)

    monkeypatch.setattr(keeper._Keeper, "_started", started)
    monkeypatch.setattr(pauses, "FIRST_PAUSE_S", 0.0)
    return list(stream(URL, stop, requests))


def sending(*messages: object, mass: bytes = b"") -> Callable[[Connection], None]:
    def tell(pipe: Connection) -> None:
        for message in messages:
            text = message if isinstance(message, bytes) else json.dumps(message).encode()
            pipe.send_bytes(text + END + mass)

    return tell


def frame(name: object = NAME, asked: object = None) -> dict[str, object]:
    return {"frame": {"name": name, "received": 3.5, "modified": 1000.0}, "asked": asked}


def test_a_frame_belongs_to_the_event_that_asked_for_it(monkeypatch: pytest.MonkeyPatch) -> None:
    def answer(pipe: Connection) -> None:
        number, ask = pipe.recv()
        assert ask.moment == 3.0
        sending(frame(asked=number), mass=JPEG)(pipe)

    found = [item for item in items_of(monkeypatch, answer, ask=True) if isinstance(item, Frame)]
    assert [(one.name, one.data, one.content_hash, one.size) for one in found] == [
        (NAME, JPEG, content_hash(JPEG), len(JPEG))
    ]
    assert found[0].taken_for == trigger_event(7, 3.0)


@pytest.mark.parametrize(
    "message",
    [
        *(frame("../../../etc/cron.d/x"), frame("stream/../x.jpg"), frame(None), frame(["x"])),
        *(b"\x00\xff", b"[1, 2]", b"{", {}, {"frame": 3}, {"notice": "x"}, {"log": ["x", 1]}),
        {"report": REPORT | COUNTS | {"state": "on fire"}},
        {"report": REPORT | COUNTS | {"seen": "many"}},
        {"report": REPORT | COUNTS | {"seen": math.inf}},
        {"log": [math.inf, "x"]},
        {"frame": {"name": NAME, "received": "x", "modified": 1}, "asked": None},
        {"frame": {"name": NAME, "received": 1, "modified": 1}, "asked": []},
    ],
    ids=str,
)
def test_what_is_no_message_ends_it_and_is_no_frame(monkeypatch: pytest.MonkeyPatch, message: object) -> None:
    found = items_of(monkeypatch, sending(message, mass=JPEG), lambda pipe: None)
    assert not [item for item in found if isinstance(item, Frame)]
    assert SAID in [item.text for item in found if isinstance(item, Notice)]


def test_counts_go_on_over_two_processes(monkeypatch: pytest.MonkeyPatch) -> None:
    told = sending({"report": REPORT | COUNTS})
    reports = [item for item in items_of(monkeypatch, told, told) if isinstance(item, SourceReport)]
    assert [(one.state, one.seen, one.taken, one.gaps) for one in reports[:3]] == [
        ("connected", 5, 2, 0),
        ("lost", 5, 2, 1),
        ("connected", 10, 4, 1),
    ]


def test_the_next_process_is_told_where_the_stream_is(monkeypatch: pytest.MonkeyPatch) -> None:
    heard: list[object] = []

    def hear(pipe: Connection) -> None:
        heard.append(pipe.recv())

    stop, requests = threading.Event(), Requests()
    requests.put(Offer("rtsp://10.0.0.7/live"))

    def started(_: object) -> Told:
        if len(heard) == 1:
            threading.Timer(0.3, stop.set).start()
        return Told(hear)

    monkeypatch.setattr(keeper._Keeper, "_started", started)
    monkeypatch.setattr(pauses, "FIRST_PAUSE_S", 0.0)
    assert [item for item in stream(URL, stop, requests) if isinstance(item, Notice)]
    assert heard[:2] == [Offer("rtsp://10.0.0.7/live")] * 2
