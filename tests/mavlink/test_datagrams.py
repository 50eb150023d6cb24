from __future__ import annotations

import socket
import threading
import time
from collections.abc import Iterator

import pytest

from gcs_mosaic.mavlink.datagrams import DatagramReader


@pytest.fixture(params=["library", "socket"])
def reader(request: pytest.FixtureRequest) -> Iterator[tuple[DatagramReader, socket.socket]]:
    """Both ways of reading, and a sender."""
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as bound,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
    ):
        bound.bind(("127.0.0.1", 0))
        sender.bind(("127.0.0.1", 0))
        sender.connect(bound.getsockname())
        reading = DatagramReader(bound)
        if request.param == "socket":
            reading._library = None
        yield reading, sender


@pytest.mark.long
def test_datagrams_come_whole_in_order_and_with_their_sender(reader: tuple[DatagramReader, socket.socket]) -> None:
    reading, sender = reader
    sent = [b"", b"\x00\xff" * 3, bytes(60_000), *(b"%d" % k for k in range(100))]
    before = time.monotonic()
    for data in sent:
        sender.send(data)
    found = [one for _ in range(3) for one in reading.read(0.5)]
    assert [one.data for one in found] == sent
    assert {one.sender for one in found} == {sender.getsockname()}
    assert all(before <= one.received <= time.monotonic() for one in found)


def test_it_waits_no_longer_than_asked(reader: tuple[DatagramReader, socket.socket]) -> None:
    reading, sender = reader
    start = time.monotonic()
    assert reading.read(0.05) == []
    assert 0.04 < time.monotonic() - start < 2
    threading.Timer(0.1, sender.send, [b"x"]).start()
    assert [one.data for one in reading.read(30.0)] == [b"x"]
    assert time.monotonic() - start < 20


def test_a_thread_that_computes_does_not_hold_up_a_thousand_datagrams() -> None:
    """One by one, each would wait for Python's lock: 5 ms each."""
    stop = threading.Event()
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as bound,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
    ):
        bound.bind(("127.0.0.1", 0))
        sender.connect(bound.getsockname())
        for _ in range(200):
            sender.send(b"x")
        busy = threading.Thread(target=lambda: [sum(range(1000)) for _ in iter(stop.is_set, True)], daemon=True)
        busy.start()
        start = time.monotonic()
        found = DatagramReader(bound).read(1.0)
        elapsed = time.monotonic() - start
        stop.set()
        busy.join()
    assert len(found) == 200
    assert elapsed < 0.5
