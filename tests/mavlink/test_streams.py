from __future__ import annotations

import io
import os
import pty
import socket
import threading
import time
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path

import pytest

from gcs_mosaic.mavlink import streams
from gcs_mosaic.mavlink.address import LinkAddress, parse_address
from gcs_mosaic.mavlink.link import Items, triggers
from gcs_mosaic.mavlink.received import Arrival
from gcs_mosaic.mavlink.settings import LinkSettings
from gcs_mosaic.mavlink.streams import StreamChannel, opener, serial
from gcs_mosaic.messages import Notice, TriggerEvent
from tests.mavlink.mavlink_peer import packet, trigger
from tests.ports import free_port

QUICK = LinkSettings(decide_after_s=0, poll_s=0.02, reconnect_first_s=0.02, reconnect_longest_s=0.05)
WAITS = (0.02, 0.04, 0.05, 0.05, 0.05)  # seconds between two tries


@pytest.fixture
def listen() -> Iterator[Callable[[str], Items]]:
    stop, opened = threading.Event(), list[Items]()

    def start(address: str) -> Items:
        opened.append(triggers(parse_address(address), stop, QUICK))
        return opened[-1]

    yield start
    stop.set()
    for heard in opened:
        list(heard)


def sequence(heard: Items) -> int | None:
    return next(item.sequence for item in heard if isinstance(item, TriggerEvent))


def said(heard: Items, text: str) -> Notice:
    return next(item for item in heard if isinstance(item, Notice) and text in item.text)


def test_a_tcp_link_is_opened_again_when_it_is_lost(listen: Callable[[str], Items]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        heard = listen(f"tcp:127.0.0.1:{server.getsockname()[1]}")
        for seq in range(2):
            said(heard, "is connected")
            with server.accept()[0] as link:
                link.sendall(packet(trigger(seq)))
                assert sequence(heard) == seq
            said(heard, "is lost")


def test_one_who_takes_the_call_and_hangs_up_is_called_at_growing_distances() -> None:
    others, calls = list[socket.socket](), list[float]()

    def call() -> io.RawIOBase:
        ours, theirs = socket.socketpair()
        calls.append(time.monotonic())
        others.append(theirs)
        if len(calls) < 6:
            theirs.close()
        else:
            theirs.send(packet(trigger(7)))
        with ours:
            return ours.makefile("rb", buffering=0)

    channel = StreamChannel("x", call, QUICK)
    came = list[Arrival | Notice]()
    while not any(isinstance(item, Arrival) for item in came):
        came += channel.read(QUICK.poll_s)
    texts = [item.text.split()[2] for item in came if isinstance(item, Notice)]
    assert texts == ["connected", "lost", "connected"]
    assert [round(later - call, 2) >= wait for (call, later), wait in zip(pairwise(calls), WAITS, strict=True)] == [
        True
    ] * 5
    channel.close()
    others[-1].close()


def test_a_tcp_link_waits_for_the_other_side(listen: Callable[[str], Items]) -> None:
    port = free_port()
    heard = listen(f"tcp:127.0.0.1:{port}")
    assert said(heard, "cannot be opened").level == "warning"
    with socket.create_server(("127.0.0.1", port)):
        said(heard, "is connected")


def test_a_tcp_caller_is_taken_and_another_after_it(listen: Callable[[str], Items]) -> None:
    port = free_port()
    heard = listen(f"tcpin:127.0.0.1:{port}")
    for seq in range(2):
        with socket.create_connection(("127.0.0.1", port)) as link:
            link.sendall(packet(trigger(seq)))
            assert sequence(heard) == seq


def test_a_serial_line_is_read_raw(listen: Callable[[str], Items]) -> None:
    ours, theirs = pty.openpty()
    heard = listen(f"serial:{os.ttyname(theirs)}:115200")
    said(heard, "is connected")
    # 13 and 10, 3 and 17: what a terminal that is not raw would change or act on.
    for seq in (0x0D0A, 0x0311):
        os.write(ours, packet(trigger(seq)))
        assert sequence(heard) == seq
    os.close(ours)
    os.close(theirs)
    assert "lost" in said(heard, "is lost").text


def test_a_serial_line_that_another_program_reads_is_not_shared(listen: Callable[[str], Items]) -> None:
    ours, theirs = pty.openpty()
    said(listen(os.ttyname(theirs)), "is connected")
    assert "cannot be opened" in said(listen(os.ttyname(theirs)), "cannot").text
    os.close(ours)
    os.close(theirs)


def test_a_serial_device_that_is_not_there_is_said(listen: Callable[[str], Items]) -> None:
    assert "No such file" in said(listen("/dev/ttyNOWHERE9"), "cannot be opened").text


def test_a_serial_line_at_a_wrong_speed_is_told_from_a_silent_one() -> None:
    ours, theirs = pty.openpty()
    stop, quick = threading.Event(), LinkSettings(decide_after_s=0, poll_s=0.02, silent_after_s=0.1)
    heard = triggers(parse_address(os.ttyname(theirs)), stop, quick)
    said(heard, "is connected")
    os.write(ours, b"\x00\x80\xf8" * 20)
    assert "speed" in said(heard, "nothing was heard").text
    stop.set()
    list(heard)
    os.close(ours)
    os.close(theirs)


def test_the_kernel_finds_out_that_the_other_side_was_switched_off() -> None:
    """Whoever only listens would wait for ever; 10 s of silence and three questions 5 s apart end it."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        stream = opener(parse_address(f"tcp:127.0.0.1:{server.getsockname()[1]}"), QUICK)()
        assert stream is not None
        with server.accept()[0], stream, socket.socket(fileno=os.dup(stream.fileno())) as ours:
            assert ours.getsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE) == 1
            wanted = {socket.TCP_KEEPIDLE: 10, socket.TCP_KEEPINTVL: 5, socket.TCP_KEEPCNT: 3}
            assert {option: ours.getsockopt(socket.IPPROTO_TCP, option) for option in wanted} == wanted


def test_a_serial_device_that_was_unplugged_is_read_again_when_it_is_back(tmp_path: Path) -> None:
    device = tmp_path / "ttyACM0"
    channel = StreamChannel("x", serial(LinkAddress(kind="serial", device=str(device))), QUICK)
    heard = list[Arrival | Notice]()
    for seq in range(2):
        ours, theirs = pty.openpty()
        device.symlink_to(os.ttyname(theirs))
        while not any(isinstance(item, Arrival) and item.message.seq == seq for item in heard):
            heard += channel.read(QUICK.poll_s)
            if channel.working:
                os.write(ours, packet(trigger(seq)))
        device.unlink()
        os.close(ours)
        os.close(theirs)
        while channel.working:
            heard += channel.read(QUICK.poll_s)
    assert [item.text.split()[2] for item in heard if isinstance(item, Notice)] == ["connected", "lost"] * 2
    channel.close()


def test_a_client_that_says_nothing_gives_its_place_to_another(
    listen: Callable[[str], Items], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(streams, "_SILENT_S", 0.1)
    port = free_port()
    heard = listen(f"tcpin:127.0.0.1:{port}")
    with socket.create_connection(("127.0.0.1", port)):
        said(heard, "is connected")
        with socket.create_connection(("127.0.0.1", port)) as other:
            said(heard, "another calls")
            other.sendall(packet(trigger(7)))
            assert sequence(heard) == 7


def test_what_cannot_be_opened_is_not_tried_once_more_at_the_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """A call that nobody answers takes seconds."""
    calls = list[object]()

    def unanswered(*_: object, **__: object) -> socket.socket:
        calls.append(None)
        raise TimeoutError("timed out")

    monkeypatch.setattr(socket, "create_connection", unanswered)
    stop = threading.Event()
    settings = LinkSettings(decide_after_s=0, poll_s=0.0, reconnect_first_s=0.0, reconnect_longest_s=0.0)
    heard = triggers(parse_address("tcp:127.0.0.1:9"), stop, settings)
    said(heard, "cannot be opened")
    before = len(calls)
    stop.set()
    list(heard)
    assert len(calls) == before
