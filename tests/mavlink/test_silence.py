"""By default not one byte is sent: counted on the wire of every kind of link, while a peer asks for everything."""

from __future__ import annotations

import os
import pty
import select
import socket
import threading
from collections.abc import Iterable

from gcs_mosaic.mavlink.address import parse_address
from gcs_mosaic.mavlink.link import Items, triggers
from gcs_mosaic.mavlink.settings import LinkSettings
from gcs_mosaic.mavlink.signing import Signing, SigningKey
from gcs_mosaic.messages import LinkReport, TriggerEvent
from tests.mavlink.hostile_peer import questions
from tests.mavlink.mavlink_peer import captured, packet, signed, trigger
from tests.ports import free_port

QUICK = LinkSettings(decide_after_s=0, poll_s=0.02, silent_after_s=0.1, reconnect_first_s=0.02)
SECRET = bytes(range(200, 232))
PACKETS = [packet(message) for message in questions()]
CALM = [packet(captured(1), component=100), packet(captured(9), component=100)]  # with a gap that might be asked for


def listening(address: str, stop: threading.Event, **more: Signing) -> Items:
    return triggers(parse_address(address), stop, QUICK, **more)  # type: ignore[arg-type]


def heard_all(heard: Items) -> None:
    """Until the last of what was sent has been heard, the silence after it noticed, and the link closed."""
    assert any(isinstance(item, TriggerEvent) and item.sequence == 99 for item in heard)
    assert next(item for item in heard if isinstance(item, LinkReport) and item.state == "silent").sent == 0


def is_empty(*descriptors: int) -> bool:
    return not select.select(descriptors, [], [], 0.1)[0]


def end(heard: Items, stop: threading.Event) -> None:
    stop.set()
    list(heard)


def hostile(packets: Iterable[bytes] = PACKETS) -> list[bytes]:
    return [*packets, *CALM, packet(trigger(99))]


def test_a_udp_peer_gets_nothing() -> None:
    port, stop = free_port(), threading.Event()
    heard = listening(f"udp:127.0.0.1:{port}", stop)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as peer:
        for data in hostile():
            peer.sendto(data, ("127.0.0.1", port))
        heard_all(heard)
        assert is_empty(peer.fileno())
        end(heard, stop)
        assert is_empty(peer.fileno())


def test_a_peer_whose_packets_are_refused_gets_nothing() -> None:
    port, stop = free_port(), threading.Event()
    heard = listening(f"udp:127.0.0.1:{port}", stop, signing=Signing(SigningKey(SECRET)))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as peer:
        for data in (*hostile(), signed(trigger(99), SECRET, 7)):
            peer.sendto(data, ("127.0.0.1", port))
        heard_all(heard)
        assert is_empty(peer.fileno())
        end(heard, stop)


def test_a_tcp_server_gets_nothing() -> None:
    stop = threading.Event()
    with socket.create_server(("127.0.0.1", 0)) as server:
        heard = listening(f"tcp:127.0.0.1:{server.getsockname()[1]}", stop)
        next(item for item in heard if isinstance(item, LinkReport))
        with server.accept()[0] as peer:
            peer.sendall(b"".join(hostile()))
            heard_all(heard)
            assert is_empty(peer.fileno())
            end(heard, stop)
            assert peer.recv(1) == b""


def test_a_tcp_caller_gets_nothing() -> None:
    port, stop = free_port(), threading.Event()
    heard = listening(f"tcpin:127.0.0.1:{port}", stop)
    with socket.create_connection(("127.0.0.1", port)) as peer:
        peer.sendall(b"".join(hostile()))
        heard_all(heard)
        assert is_empty(peer.fileno())
        end(heard, stop)
        assert peer.recv(1) == b""


def test_a_serial_line_carries_nothing_outwards() -> None:
    stop = threading.Event()
    ours, theirs = pty.openpty()
    heard = listening(os.ttyname(theirs), stop)
    next(item for item in heard if isinstance(item, LinkReport))
    written = threading.Thread(target=os.write, args=(ours, b"".join(hostile())))
    written.start()
    heard_all(heard)
    written.join()
    assert is_empty(ours)
    end(heard, stop)
    os.close(ours)
    os.close(theirs)
