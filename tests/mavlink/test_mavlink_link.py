from __future__ import annotations

import errno
import os
import socket
import threading
import time
from collections.abc import Iterator
from typing import Never

import pytest

from gcs_mosaic.errors import UsageError
from gcs_mosaic.mavlink import link
from gcs_mosaic.mavlink.address import parse_address
from gcs_mosaic.mavlink.datagrams import Datagram, DatagramReader
from gcs_mosaic.mavlink.link import triggers
from gcs_mosaic.mavlink.settings import LinkSettings
from gcs_mosaic.messages import Notice, TriggerEvent
from tests.mavlink.mavlink_peer import captured, feedback, heartbeat, packet, trigger
from tests.ports import free_port

QUICK = LinkSettings(decide_after_s=0, poll_s=0.02, silent_after_s=0.1, reconnect_first_s=0.02)


class Vehicle:
    """A peer on a real UDP socket, and the daemon's ear on another."""

    def __init__(self) -> None:
        self.port, self.stop = free_port(), threading.Event()
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.heard = triggers(parse_address(f"udp:127.0.0.1:{self.port}"), self.stop, QUICK)

    def send(self, *packets: bytes) -> None:
        for data in packets:
            self.socket.sendto(data, ("127.0.0.1", self.port))

    def next_event(self) -> TriggerEvent:
        return next(item for item in self.heard if isinstance(item, TriggerEvent))

    def next_notice(self, text: str) -> Notice:
        return next(item for item in self.heard if isinstance(item, Notice) and text in item.text)


@pytest.fixture
def vehicle() -> Iterator[Vehicle]:
    peer = Vehicle()
    yield peer
    peer.stop.set()
    assert any("closed" in item.text for item in peer.heard if isinstance(item, Notice))
    peer.socket.close()


def test_all_three_messages_are_heard(vehicle: Vehicle) -> None:
    vehicle.send(packet(trigger(1)), packet(feedback(2)), packet(captured(3, file_url=b"a/b.jpg"), component=100))
    events = [vehicle.next_event() for _ in range(3)]
    assert [event.sequence for event in events] == [1, 2, 3]
    assert events[2].file_hint == "a/b.jpg"
    assert 0 <= time.monotonic() - events[0].received < 5


@pytest.mark.long
def test_noise_from_one_peer_harms_no_other(vehicle: Vehicle) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        for seq in range(50):
            stranger.sendto(b"\xfd\xff" + bytes(40), ("127.0.0.1", vehicle.port))
            vehicle.send(b"", packet(trigger(seq)))
    assert [vehicle.next_event().sequence for _ in range(50)] == list(range(50))


def test_a_link_says_what_it_hears_and_when_it_hears_nothing(vehicle: Vehicle) -> None:
    vehicle.next_notice("listening on udpin:127.0.0.1")
    vehicle.send(packet(heartbeat(), system=9))
    vehicle.next_notice("system 9")
    assert vehicle.next_notice("silent").level == "warning"
    vehicle.send(packet(heartbeat(), system=9))
    vehicle.next_notice("heard again")


def test_a_link_that_never_spoke_is_not_heard_again(vehicle: Vehicle) -> None:
    vehicle.next_notice("nothing was heard on")
    vehicle.send(packet(heartbeat(), system=9))
    assert "heard for the first time" in vehicle.next_notice(" is heard ").text


def test_a_taken_port_is_refused_by_the_call_itself(vehicle: Vehicle) -> None:
    with pytest.raises(UsageError, match=f"UDP port {vehicle.port} is taken"):
        triggers(parse_address(f"udp:127.0.0.1:{vehicle.port}"), threading.Event())


def test_no_failure_ends_a_link(vehicle: Vehicle, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(link, "AGAIN_S", 0.01)
    failures, read = [RuntimeError("unforeseen"), OSError(113, "No route to host"), RuntimeError()], DatagramReader.read

    def failing(self: DatagramReader, timeout_s: float) -> list[Datagram]:
        if failures:
            raise failures.pop(0)
        return read(self, timeout_s)

    monkeypatch.setattr(DatagramReader, "read", failing)
    said = [vehicle.next_notice("has failed").text.partition(" has failed ")[2] for _ in range(2)]
    assert said == ["(RuntimeError); it is listened to again", "(OSError 113); it is listened to again"]
    vehicle.send(packet(trigger(1)))
    assert vehicle.next_event().sequence == 1


@pytest.mark.parametrize("error", [errno.EHOSTUNREACH, errno.ENETUNREACH, errno.ECONNREFUSED])
def test_what_the_network_says_of_packets_sent_before_is_no_failure(error: int) -> None:
    class Told(socket.socket):
        def recvmsg(self, *_: object) -> Never:
            raise OSError(error, os.strerror(error))

    with Told(socket.AF_INET6, socket.SOCK_DGRAM) as bound:
        bound.bind(("::1", 0))
        assert DatagramReader(bound).read(0.01) == []
