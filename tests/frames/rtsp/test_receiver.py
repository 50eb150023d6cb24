from __future__ import annotations

import logging
import sys
import threading
from typing import TYPE_CHECKING

import pytest

from gcs_mosaic.errors import UsageError
from gcs_mosaic.frames.rtsp.address import StreamAddress, parse_stream
from gcs_mosaic.frames.rtsp.keeper import stream
from gcs_mosaic.frames.rtsp.requests import Requests
from gcs_mosaic.frames.rtsp.ring_buffer import Ring
from gcs_mosaic.frames.rtsp.settings import StreamSettings

if TYPE_CHECKING:
    from gcs_mosaic.frames.rtsp.connection import Log

SECRET = "s3cr3t"
URL = f"rtsp://pilot:{SECRET}@127.0.0.1:9/x"  # where nobody listens
SETTINGS = StreamSettings(reconnect_first_s=0.01, reconnect_longest_s=0.05)


def said(times: int) -> tuple[list[str], int]:
    """What a receiver says while it tries to connect so many times, and how often it really tried."""
    pytest.importorskip("av")
    from gcs_mosaic.frames.rtsp import receiver
    from gcs_mosaic.frames.rtsp.connection import Connection

    stop, tried = threading.Event(), threading.Semaphore(0)
    opened = Connection.open

    def opening(address: StreamAddress, settings: StreamSettings, log: Log) -> object:
        tried.release()
        return opened(address, settings, log)

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(Connection, "open", opening)
        one = receiver.Receiver(Ring(1.0, 1), SETTINGS, stop)
        one.use(parse_stream(URL))
        one.start()
        count = sum(tried.acquire(timeout=20) for _ in range(times))
        stop.set()
        one.join()
    texts = []
    while not one.notices.empty():
        texts.append(one.notices.get().text)
    return texts, count


def test_a_camera_that_is_not_there_is_tried_again_and_that_is_said_once() -> None:
    texts, tried = said(times=4)
    assert tried == 4
    (text,) = texts
    assert text == "rtsp://127.0.0.1:9/x cannot be received (Connection refused); trying again until it can"


def test_a_fault_of_our_own_ends_nothing_and_shows_no_address(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    pytest.importorskip("av")
    from gcs_mosaic.frames.rtsp.connection import Connection

    def faulty(address: object, settings: object, log: object) -> object:
        raise RuntimeError(URL)

    monkeypatch.setattr(Connection, "open", faulty)
    texts, tried = said(times=3)
    assert tried == 3
    assert texts == [
        "rtsp://127.0.0.1:9/x cannot be received (a fault of the kind RuntimeError); trying again until it can"
    ]
    (record,) = caplog.records  # said once, logged once
    logged = logging.Formatter().format(record)
    assert "in faulty" in logged
    assert URL not in logged
    assert SECRET not in logged


def test_without_pyav_it_is_said_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(UsageError, match=r"pip install 'gcs-mosaic\[rtsp\]'"):
        stream(URL, threading.Event(), Requests())
