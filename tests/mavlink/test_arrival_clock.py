"""Kernel receive times become monotonic ones, whatever happens to UTC."""

from __future__ import annotations

import socket
import time

import pytest

from gcs_mosaic.mavlink.arrival_clock import ArrivalClock
from gcs_mosaic.mavlink.datagrams import DatagramReader
from gcs_mosaic.mavlink.received import Arrival
from gcs_mosaic.mavlink.streams import spread
from tests.mavlink.mavlink_peer import received, trigger

UTC = 1.75e9  # at the monotonic clock's zero


@pytest.mark.parametrize("jump", [0.0, 3600.0, -86400.0, 3.15e8])
@pytest.mark.parametrize("before", [True, False], ids=["came before the jump", "came after the jump"])
def test_a_clock_that_is_set_meanwhile_changes_no_arrival(jump: float, before: bool) -> None:
    clock = ArrivalClock(100.0, UTC + 100.0)
    clock.emptied(100.0)
    clock.read_at(120.0, UTC + jump + 120.0)
    stamp = UTC + 107.0 + (0.0 if before else jump)
    assert clock.arrived(stamp, 120.0) == pytest.approx(107.0)


def test_what_came_before_a_suspension_in_which_the_monotonic_clock_stands_still() -> None:
    clock = ArrivalClock(100.0, UTC + 100.0)
    clock.emptied(100.0)
    clock.read_at(101.0, UTC + 101.0 + 3000.0)
    assert clock.arrived(UTC + 100.4, 101.0) == pytest.approx(100.4)
    assert clock.arrived(UTC + 3100.7, 101.0) == pytest.approx(100.7)


@pytest.mark.parametrize("stamp", [0.0, UTC - 1e6, UTC + 99.0, UTC + 130.0, float("nan")])
def test_a_stamp_that_cannot_be_true_is_the_time_of_reading(stamp: float) -> None:
    clock = ArrivalClock(100.0, UTC + 100.0)
    clock.emptied(100.0)
    clock.read_at(120.0, UTC + 120.0)
    assert clock.arrived(stamp, 120.0) == 120.0


@pytest.mark.parametrize("family", [socket.AF_INET, socket.AF_INET6])
def test_what_waited_in_the_kernel_is_dated_by_its_arrival(family: socket.AddressFamily) -> None:
    host = "127.0.0.1" if family == socket.AF_INET else "::1"
    with socket.socket(family, socket.SOCK_DGRAM) as bound, socket.socket(family, socket.SOCK_DGRAM) as sender:
        try:
            bound.bind((host, 0))
        except OSError:
            pytest.skip("this machine has no IPv6")
        reading = DatagramReader(bound)
        sender.connect(bound.getsockname())
        # Linux begins to stamp a moment after the first socket asks for it; until then the reading is the stamp.
        time.sleep(0.3)
        sent = []
        for _ in range(3):
            before = time.monotonic()
            sender.send(b"x")
            sent.append((before, time.monotonic()))
            time.sleep(0.2)
        found = [datagram.received for datagram in reading.read(1.0)]
    for moment, (before, after) in zip(found, sent, strict=True):
        assert before - 0.1 < moment < after + 0.1


def test_what_a_stream_held_is_spread_over_the_pause_and_marked() -> None:
    messages = [received(trigger(k)) for k in range(1, 11)]
    size = sum(len(message.get_msgbuf()) for message in messages)
    found = list(spread(messages, size, 100.0, 110.0))
    assert all(isinstance(one, Arrival) and one.latest == 110.0 for one in found)
    assert [one.received for one in found] == pytest.approx(range(101, 111), abs=0.3)
