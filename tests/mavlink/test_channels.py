from __future__ import annotations

import select
import socket
import time
from collections.abc import Iterator
from contextlib import ExitStack

import pytest

from gcs_mosaic.mavlink.address import LinkAddress
from gcs_mosaic.mavlink.channels import UdpChannel
from gcs_mosaic.mavlink.received import Arrival
from gcs_mosaic.mavlink.settings import LinkSettings
from tests.mavlink.mavlink_peer import heartbeat, packet, trigger


def has_ipv6() -> bool:
    if not socket.has_ipv6:
        return False
    with socket.socket(socket.AF_INET6, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(("::1", 0))
        except OSError:
            return False
    return True


PACKET = packet(heartbeat(), system=191, component=191)


class Many:
    """A channel and any number of peers that have spoken on it."""

    def __init__(self, stack: ExitStack) -> None:
        self.stack = stack
        self.channel = UdpChannel(LinkAddress(kind="udp", host="127.0.0.1"), LinkSettings())  # at any port
        self.to = self.channel._socket.getsockname()
        stack.callback(self.channel.close)

    def peer(self, *data: bytes) -> socket.socket:
        made = self.stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        made.bind(("127.0.0.1", 0))
        for datagram in data:
            made.sendto(datagram, self.to)
            self.channel.read(1.0)
        return made


@pytest.fixture
def many() -> Iterator[Many]:
    with ExitStack() as stack:
        yield Many(stack)


def reached(peers: list[socket.socket]) -> int:
    return len(select.select(peers, [], [], 0.1)[0])


def test_before_anybody_is_heard_there_is_nobody_to_send_to(many: Many) -> None:
    assert not many.channel.send(PACKET)


def test_at_most_32_peers_are_sent_to_the_newest_of_them(many: Many) -> None:
    peers = [many.peer(packet(trigger(1))) for _ in range(50)]
    assert many.channel.send(PACKET)
    assert (reached(peers[:18]), reached(peers[18:])) == (0, 32)


def test_who_sends_no_mavlink_is_not_sent_to(many: Many) -> None:
    peers = [many.peer(data) for data in (b"", b"hello", b"\xfd" + bytes(40), PACKET[:-1] + b"\x00")]
    assert not many.channel.send(PACKET)
    assert reached(peers) == 0


def test_who_was_not_heard_for_a_while_is_not_sent_to(many: Many, monkeypatch: pytest.MonkeyPatch) -> None:
    gone, there, now = many.peer(packet(trigger(1))), many.peer(), time.monotonic()
    monkeypatch.setattr(time, "monotonic", lambda: now + 9.0)
    there.sendto(packet(trigger(2)), many.to)
    assert isinstance(many.channel.read(1.0)[0], Arrival)
    monkeypatch.setattr(time, "monotonic", lambda: now + 11.0)
    assert many.channel.send(PACKET)
    assert (reached([gone]), reached([there])) == (0, 1)


def test_what_is_read_from_one_peer_is_not_mixed_with_what_another_sends(many: Many) -> None:
    one, other = many.peer(), many.peer()
    begun, rest = packet(trigger(7))[:9], packet(trigger(7))[9:]
    came = []
    for sender, data in ((one, begun), (other, packet(trigger(8))), (one, rest)):
        sender.sendto(data, many.to)
        came += [item.message.seq for item in many.channel.read(1.0) if isinstance(item, Arrival)]
    assert came == [8, 7]


@pytest.mark.skipif(not has_ipv6(), reason="IPv6 is switched off on this machine: nothing can be bound to ::1")
def test_a_peer_is_heard_over_ipv6_and_answered() -> None:
    with ExitStack() as stack:
        channel = UdpChannel(LinkAddress(kind="udp", host="::1"), LinkSettings())
        stack.callback(channel.close)
        peer = stack.enter_context(socket.socket(socket.AF_INET6, socket.SOCK_DGRAM))
        peer.bind(("::1", 0))
        peer.sendto(packet(trigger(1)), channel._socket.getsockname()[:2])
        (heard,) = channel.read(2.0)
        assert isinstance(heard, Arrival)
        assert heard.sender == f"[::1]:{peer.getsockname()[1]}"
        assert channel.send(PACKET)
        assert reached([peer]) == 1
