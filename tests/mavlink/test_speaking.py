"""What goes out on real links when announcing was asked for: to whom, as whom, and how it is signed."""

from __future__ import annotations

import os
import pty
import socket
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field

import pytest

from gcs_mosaic.errors import UsageError
from gcs_mosaic.mavlink.address import parse_address
from gcs_mosaic.mavlink.announcements import Announcement
from gcs_mosaic.mavlink.link import triggers
from gcs_mosaic.mavlink.parser import PacketReader, dialect
from gcs_mosaic.mavlink.resend import Recovery
from gcs_mosaic.mavlink.settings import LinkSettings
from gcs_mosaic.mavlink.signing import Signing, SigningKey
from gcs_mosaic.mavlink.speaker import Speaker
from gcs_mosaic.mavlink.streams import StreamChannel, opener
from gcs_mosaic.mavlink.transmitter import Transmitter
from gcs_mosaic.messages import LinkReport, Notice, Refusals, StreamOffer, TriggerEvent
from tests.mavlink.hostile_peer import questions
from tests.mavlink.mavlink_peer import Message, captured, heartbeat, packet, signed, trigger
from tests.ports import free_port

LOUD = LinkSettings(decide_after_s=0, announce=191, poll_s=0.02, reconnect_first_s=0.02)
SECRET = bytes(range(200, 232))
LONGEST_WAIT_S = 10.0


@dataclass
class Link:
    """A link that is listened to on a thread of its own, as in the program; what it brings is kept."""

    address: str
    signing: Signing | None = None
    recovery: Recovery | None = None
    items: list[TriggerEvent | StreamOffer | Notice | LinkReport] = field(default_factory=list)
    stop: threading.Event = field(default_factory=threading.Event)

    def __enter__(self) -> Link:
        self.speaker = Speaker(self.address, Transmitter(191, 1.75e9, self.signing), self.recovery)
        heard = triggers(parse_address(self.address), self.stop, LOUD, signing=self.signing, speaker=self.speaker)
        self.thread = threading.Thread(target=lambda: deque(map(self.items.append, heard)))
        self.thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop.set()
        self.thread.join()

    @property
    def report(self) -> LinkReport:
        return [item for item in self.items if isinstance(item, LinkReport)][-1]

    def texts(self) -> str:
        return "\n".join(item.text for item in self.items if isinstance(item, Notice))


class Peer:
    """Somebody at the other end of a datagram socket."""

    def __init__(self, port: int = 0) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(0.05)
        self.to, self.reader = ("127.0.0.1", port), PacketReader(datagrams=True)

    def send(self, *packets: bytes) -> None:
        for data in packets:
            self.socket.sendto(data, self.to)

    def messages(self, seconds: float) -> list[Message]:
        """All that comes within so many seconds."""
        until, came = time.monotonic() + seconds, list[Message]()
        while time.monotonic() < until:
            with suppress(TimeoutError):
                data, self.to = self.socket.recvfrom(65535)
                came += self.reader.feed(data)
        return came

    def wait_for(self, right: Callable[[Message], object]) -> Message:
        until = time.monotonic() + LONGEST_WAIT_S
        while time.monotonic() < until:
            for message in self.messages(0.05):
                if right(message):
                    return message
        raise AssertionError("it never came")


@pytest.fixture
def peers() -> Iterator[Callable[[int], Peer]]:
    made = list[Peer]()

    def make(port: int) -> Peer:
        made.append(Peer(port))
        return made[-1]

    yield make
    for peer in made:
        peer.socket.close()


def until(true: Callable[[], object]) -> None:
    deadline = time.monotonic() + LONGEST_WAIT_S
    while not true():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def is_beat(message: Message) -> bool:
    return bool(message.get_type() == "HEARTBEAT")


@pytest.mark.long
def test_a_heartbeat_goes_to_whom_we_hear_and_to_nobody_else(peers: Callable[[int], Peer]) -> None:
    port = free_port()
    aircraft, stranger = peers(port), peers(port)
    with Link(f"udp:127.0.0.1:{port}") as link:
        stranger.send(b"", b"hello", b"\xfd" + bytes(30))
        assert aircraft.messages(0.3) == []
        aircraft.send(packet(heartbeat()))
        beat = aircraft.wait_for(is_beat)
        assert (beat.get_srcSystem(), beat.get_srcComponent()) == (191, 191)
        aircraft.send(packet(heartbeat()))
        assert 1 <= len([message for message in aircraft.messages(1.6) if is_beat(message)]) <= 2
        assert stranger.messages(0.1) == []
        until(lambda: link.report.sent >= 2)
    assert "announcing ourselves as system 191, component 191" in link.texts()


@pytest.mark.long
def test_nothing_but_heartbeats_answers_a_peer_that_asks_for_everything(peers: Callable[[int], Peer]) -> None:
    port = free_port()
    aircraft = peers(port)
    with Link(f"udp:127.0.0.1:{port}", recovery=Recovery()):
        aircraft.send(*(packet(question) for question in questions()))
        assert {message.get_type() for message in aircraft.messages(1.3)} == {"HEARTBEAT"}


def test_what_is_told_reaches_the_ground_station(peers: Callable[[int], Peer]) -> None:
    port = free_port()
    station = peers(port)
    with Link(f"udp:127.0.0.1:{port}") as link:
        station.send(packet(heartbeat(kind=6), system=255))
        station.wait_for(is_beat)
        for _ in range(100):
            link.speaker.tell(Announcement("overlap", "Mosaic: overlap lost"))
        text = station.wait_for(lambda message: message.get_type() == "STATUSTEXT")
        assert (text.text, text.severity) == ("Mosaic: overlap lost", dialect.MAV_SEVERITY_WARNING)
        assert {message.get_type() for message in station.messages(0.5)} <= {"HEARTBEAT"}


@pytest.mark.long
def test_what_is_told_before_anybody_listens_is_said_when_somebody_does(peers: Callable[[int], Peer]) -> None:
    port = free_port()
    station = peers(port)
    with Link(f"udp:127.0.0.1:{port}") as link:
        link.speaker.tell(Announcement("disk", "Mosaic: the disk is filling up"))
        time.sleep(0.2)
        assert link.report.sent == 0
        station.send(packet(heartbeat(kind=6), system=255))
        assert "disk" in station.wait_for(lambda message: message.get_type() == "STATUSTEXT").text


def test_calling_out_reaches_one_who_waits_and_hears_the_answer(peers: Callable[[int], Peer]) -> None:
    router = peers(0)
    with Link(f"udpout:127.0.0.1:{router.socket.getsockname()[1]}") as link:
        router.wait_for(is_beat)
        router.send(packet(trigger(5)))
        until(lambda: any(isinstance(item, TriggerEvent) for item in link.items))


def test_calling_out_needs_a_name() -> None:
    with pytest.raises(UsageError, match=r"calls out.*use udp:14550.*or add --announce"):
        triggers(parse_address("udpout:127.0.0.1:14550"), threading.Event(), LinkSettings())
    with pytest.raises(UsageError, match="cannot be called"):
        triggers(parse_address("udpout:no-such-host.invalid:14550"), threading.Event(), LOUD)


@pytest.mark.long
def test_a_number_that_another_has_ends_all_sending(peers: Callable[[int], Peer]) -> None:
    port = free_port()
    aircraft = peers(port)
    with Link(f"udp:127.0.0.1:{port}") as link:
        aircraft.send(packet(heartbeat(), system=191, component=191))  # our own, sent back by a router
        aircraft.wait_for(is_beat)
        aircraft.send(packet(heartbeat(), system=191, component=1))
        until(lambda: "another has our number, 191" in link.texts())
        aircraft.messages(0.1)
        assert aircraft.messages(1.3) == []


@pytest.mark.long
def test_a_camera_is_asked_for_what_was_lost_and_its_answer_is_an_event(peers: Callable[[int], Peer]) -> None:
    port = free_port()
    camera = peers(port)
    with Link(f"udp:127.0.0.1:{port}", recovery=Recovery()) as link:
        camera.send(*(packet(captured(index, time_boot_ms=1000 * index), component=100) for index in (4, 6)))
        question = camera.wait_for(lambda message: message.get_type() == "COMMAND_LONG")
        assert (question.command, question.param1, question.param2) == (512, 263, 5)
        camera.send(packet(captured(round(question.param2), time_boot_ms=5000), component=100))
        until(lambda: 5 in [item.sequence for item in link.items if isinstance(item, TriggerEvent)])
        assert "COMMAND_LONG" not in {message.get_type() for message in camera.messages(1.2)}


@pytest.mark.long
def test_a_camera_that_denies_is_asked_no_more_and_that_is_said(peers: Callable[[int], Peer]) -> None:
    port = free_port()
    camera = peers(port)
    with Link(f"udp:127.0.0.1:{port}", recovery=Recovery()) as link:
        camera.send(*(packet(captured(index), component=100) for index in (4, 9)))
        camera.wait_for(lambda message: message.get_type() == "COMMAND_LONG")
        denial = dialect.MAVLink_command_ack_message(512, dialect.MAV_RESULT_DENIED, target_system=191)
        camera.send(packet(denial, component=100))
        until(lambda: "is asked no more" in link.texts())
        assert "COMMAND_LONG" not in {message.get_type() for message in camera.messages(1.5)}


@pytest.mark.long
def test_with_a_key_what_is_heard_must_be_signed_and_what_is_said_is(peers: Callable[[int], Peer]) -> None:
    port = free_port()
    aircraft, forger = peers(port), peers(port)
    with Link(f"udp:127.0.0.1:{port}", signing=Signing(SigningKey(SECRET))) as link:
        forger.send(packet(trigger(1)), packet(trigger(2)), signed(trigger(3), bytes(range(32)), 9))
        aircraft.send(signed(trigger(4), SECRET, 1000), signed(trigger(4), SECRET, 1000))
        station = dialect.MAVLink(None)
        station.signing.secret_key = SECRET
        aircraft.socket.settimeout(LONGEST_WAIT_S)
        for _ in range(2):
            data = aircraft.socket.recv(300)
            assert station.decode(bytearray(data)).get_type() == "HEARTBEAT"  # raises if its signature is not right
        assert forger.messages(0.1) == []
        assert [item.sequence for item in link.items if isinstance(item, TriggerEvent)] == [4]
        until(lambda: link.report.refused == Refusals(unsigned=2, forged=1, replayed=1))
    for reason in ("unsigned", "forged", "replayed"):
        assert link.texts().count(f"{reason} packets are refused") == 1
    assert SECRET.hex() not in repr(link.items)


@pytest.mark.long
def test_a_tcp_link_is_spoken_on_even_after_it_was_lost() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(LONGEST_WAIT_S)
        with Link(f"tcp:127.0.0.1:{server.getsockname()[1]}"):
            for _ in range(2):
                with server.accept()[0] as peer:
                    peer.settimeout(LONGEST_WAIT_S)
                    peer.sendall(packet(heartbeat()))
                    assert is_beat(PacketReader(datagrams=False).feed(peer.recv(300))[0])


def test_one_who_takes_nothing_makes_nobody_wait_and_gets_whole_packets() -> None:
    sent, came = 0, b""
    long = packet(captured(1, file_url=b"x" * 200)) * 300  # so that it is cut off somewhere
    with socket.create_server(("127.0.0.1", 0)) as server:
        address = parse_address(f"tcp:127.0.0.1:{server.getsockname()[1]}")
        channel = StreamChannel("x", opener(address, LOUD), LOUD)
        channel.read(0.0)  # opens it
        begun = time.monotonic()
        with server.accept()[0] as peer:
            while channel.send(long):
                sent += 1
            assert time.monotonic() - begun < LONGEST_WAIT_S
            peer.settimeout(0.2)
            for _ in range(2):  # what waits, and what may follow then
                with suppress(TimeoutError):
                    while data := peer.recv(1 << 16):
                        came += data
                sent += channel.send(long)
            channel.close()
            while data := peer.recv(1 << 16):
                came += data
    assert came == sent * long
    assert sent > 3


def test_a_serial_line_is_spoken_on() -> None:
    ours, theirs = pty.openpty()
    with Link(os.ttyname(theirs)):
        assert is_beat(PacketReader(datagrams=False).feed(os.read(ours, 300))[0])
    os.close(ours)
    os.close(theirs)
