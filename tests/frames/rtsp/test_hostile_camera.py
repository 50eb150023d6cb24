"""A camera that means harm, or is broken: it costs a few lines, a bounded process, and no trigger of another source."""

from __future__ import annotations

import itertools
import random
import re
import socket
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

pytest.importorskip("av")

from gcs_mosaic.frames.rtsp.address import parse_stream
from gcs_mosaic.frames.rtsp.connection import Connection, NotConnected
from gcs_mosaic.frames.rtsp.keeper import stream
from gcs_mosaic.frames.rtsp.receiver import MOST_GAPS, MOST_SIZES, Receiver
from gcs_mosaic.frames.rtsp.redirect import final_address
from gcs_mosaic.frames.rtsp.requests import Requests
from gcs_mosaic.frames.rtsp.ring_buffer import Ring
from gcs_mosaic.frames.rtsp.settings import StreamSettings
from gcs_mosaic.frames.rtsp.source import Item
from gcs_mosaic.messages import Notice
from tests.frames.rtsp.hostile_camera import SDP, HostileCamera, rtp

QUICK = StreamSettings(open_timeout_s=1.0, read_timeout_s=1.0, reconnect_first_s=0.05, reconnect_longest_s=0.05)
MOST_MB = 1500  # of the process that receives
PEAK = re.compile(r"VmHWM:\s+(\d+) kB")


def noise(least: int, most: int) -> Iterator[bytes]:
    chance = random.Random(7)
    while True:
        yield chance.randbytes(chance.randint(least, most))


def payloads(kind: int = 96) -> Iterator[bytes]:
    """Packets with random contents, as if they were H.264: some make pictures, each of another size."""
    for number, payload in enumerate(noise(0, 1400)):
        yield rtp(payload, number, 3000 * number, kind)


def fragments() -> Iterator[bytes]:
    """One picture, in parts without end."""
    for number in itertools.count():
        yield rtp(bytes([0x7C, 0x05 if number else 0x85]) + bytes(1380), number, 1000, last=False)


def described(length: str) -> HostileCamera:
    head = f"RTSP/1.0 200 OK\r\nCSeq: %d\r\nContent-Type: application/sdp\r\nContent-Length: {length}\r\n\r\nv=0\r\n"
    return HostileCamera(answers={"DESCRIBE": head.encode()})


def one_letter_at_a_time(connection: socket.socket, _: HostileCamera) -> None:
    while True:
        connection.sendall(b"R")
        time.sleep(0.1)


def a_head_without_end(connection: socket.socket, _: HostileCamera) -> None:
    connection.sendall(b"RTSP/1.0 200 OK\r\n")
    while True:
        connection.sendall(b"X-A: " + b"b" * 4000 + b"\r\n")


def opened(camera: HostileCamera) -> Connection | NotConnected:
    return Connection.open(parse_stream(camera.url), QUICK, [])


@pytest.mark.parametrize("length", ["2147483640", "99999999999", "1048577"])
def test_a_description_of_gigabytes_is_not_waited_for(length: str) -> None:
    """FFmpeg took 1.7 GB into memory."""
    with described(length) as camera:
        said = final_address(parse_stream(camera.url), (), 2.0)
        assert isinstance(said, str)
        assert f"a description of {length} bytes" in said


UNUSUAL = {
    "negative length": described("-5"),
    "no number": described("many"),
    "a coding that nobody knows": HostileCamera(sdp=SDP.replace("H264/90000", "X-HARM/0/99999")),
    "no tracks": HostileCamera(sdp="v=0\n"),
    "sound alone": HostileCamera(sdp=SDP.replace("video", "audio")),
    "an answer without end": HostileCamera(talk=a_head_without_end),
    "one letter at a time": HostileCamera(talk=one_letter_at_a_time),
    "lies about the session": HostileCamera(
        answers={"SETUP": b"RTSP/1.0 200 OK\r\nCSeq: %d\r\nTransport: " + b"x" * 5000 + b"\r\n\r\n"}
    ),
}


@pytest.mark.long
@pytest.mark.parametrize("name", UNUSUAL)
def test_a_stream_that_cannot_be_received_is_refused_with_a_reason_and_in_time(name: str) -> None:
    began = time.monotonic()
    with UNUSUAL[name] as camera:
        found = opened(camera)
    assert isinstance(found, NotConnected)
    assert found.reason
    assert "127.0.0.1" not in found.reason
    assert time.monotonic() - began < 10.0


def said_by(camera: HostileCamera, enough: Callable[[list[str]], bool]) -> list[str]:
    """What a receiver tells of a camera, until that is enough or five seconds are over."""
    stop = threading.Event()
    receiver = Receiver(Ring(4.0, 10**8), QUICK, stop)
    receiver.use(parse_stream(camera.url))
    receiver.start()
    end, said = time.monotonic() + 5.0, list[str]()
    while time.monotonic() < end and not enough(said):
        time.sleep(0.05)
        while not receiver.notices.empty():
            said.append(receiver.notices.get().text)
    stop.set()
    receiver.join()
    return said


@pytest.mark.long
def test_a_camera_that_breaks_off_again_and_again_is_told_of_once() -> None:
    """Two lines a second, for as long as it did."""
    with HostileCamera(flood=lambda: noise(4000, 4000)) as camera:
        said = said_by(camera, lambda _: camera.calls > 8)
        assert camera.calls > 4
    assert len(said) <= 4
    assert sum("is lost" in text for text in said) == 1


@pytest.mark.long
@pytest.mark.parametrize(
    "coding", ["H264", *(pytest.param(one, marks=pytest.mark.thorough) for one in ("JPEG", "H265", "VP9", "AV1"))]
)
@pytest.mark.parametrize("flood", [payloads, lambda: noise(4000, 4000), fragments], ids=["payloads", "noise", "parts"])
def test_whatever_a_camera_sends_costs_few_lines_and_a_bounded_process(
    coding: str, flood: Callable[[], Iterator[bytes]]
) -> None:
    """Random packets brought 60 lines a second: each picture of them had another size."""
    stop, items, peak = threading.Event(), list[Item](), 0.0
    with HostileCamera(sdp=SDP.replace("H264", coding), flood=flood) as camera:
        thread = threading.Thread(target=lambda: items.extend(stream(camera.url, stop, Requests())))
        thread.start()
        end = time.monotonic() + 8.0
        while time.monotonic() < end:
            peak = max(peak, *(peak_mb(process) for process in children()))
            time.sleep(0.2)
        stop.set()
        thread.join()
    notices = [item.text for item in items if isinstance(item, Notice)]
    assert peak < MOST_MB
    assert len(notices) <= 6 + MOST_SIZES + MOST_GAPS
    assert not any("Traceback" in text or "fault of the kind" in text for text in notices)


def children() -> list[str]:
    """Ids of the processes that threads of this one have started (Linux); one that is none, where systems do not say."""
    lists = Path("/proc/self/task").glob("*/children")
    return [process for one in lists for process in one.read_text().split()] or ["none"]


def peak_mb(process: str) -> float:
    try:
        found = PEAK.search(Path(f"/proc/{process}/status").read_text())
    except OSError:
        return 0.0
    return int(found[1]) / 1024 if found else 0.0
