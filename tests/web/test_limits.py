"""What one visitor may take, so that the others are served too."""

from __future__ import annotations

import asyncio
import gc
import logging
import re
import socket
import ssl
import time
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from pathlib import Path

import pytest
from aiohttp import web

from gcs_mosaic.web import request_handler
from gcs_mosaic.web.address import HttpAddress
from gcs_mosaic.web.address_quota import AddressQuota, origin_of
from gcs_mosaic.web.feed import Feed
from gcs_mosaic.web.listener import PageListener, listening
from gcs_mosaic.web.server import WebServer
from gcs_mosaic.web.settings import WebSettings
from gcs_mosaic.web.sparing_log import SparingHandler
from tests.running import until
from tests.web.small_flight import SmallFlight

PATIENT = WebSettings(connections=12, connections_per_address=4)
HASTY = WebSettings(connections=12, connections_per_address=4, request_s=0.3, answer_s=0.5)
REQUEST = b"GET /mosaic.json HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"


@pytest.fixture
def port(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    monkeypatch.setattr(request_handler, "TICK_S", 0.02)
    SmallFlight(tmp_path).write()
    server = WebServer(tmp_path, HttpAddress("0.0.0.0", 0), Feed(), settings=HASTY)
    server.start()
    yield server.port
    server.stop()


@pytest.fixture
def patient(tmp_path: Path) -> Iterator[int]:
    """The port of a server that waits for longer than a test."""
    SmallFlight(tmp_path).write()
    server = WebServer(tmp_path, HttpAddress("0.0.0.0", 0), Feed(), settings=PATIENT)
    server.start()
    yield server.port
    server.stop()


def connect(port: int, sender: str = "127.0.0.1") -> socket.socket:
    return socket.create_connection(("127.0.0.1", port), timeout=10, source_address=(sender, 0))


def answer(port: int, sent: bytes = REQUEST, sender: str = "127.0.0.1") -> bytes:
    """What is answered on a connection of its own until it is closed; empty if it is closed at once."""
    with connect(port, sender) as one:
        try:
            one.sendall(sent)
            return b"".join(iter(lambda: one.recv(65536), b""))
        except ConnectionError:
            return b""


def is_served(port: int, sender: str = "127.0.0.1") -> bool:
    with connect(port, sender) as one:
        try:
            one.sendall(REQUEST)
            return one.recv(65536).startswith(b"HTTP/1.1 200")
        except ConnectionError:
            return False


def seconds_until_closed(one: socket.socket) -> float:
    start = time.monotonic()
    with suppress(ConnectionError):
        while one.recv(65536):
            pass
    return time.monotonic() - start


@pytest.mark.parametrize("sent", [b"", b"GET / HTTP/1.1\r\nHost: 1", REQUEST, REQUEST + b"GET /half"])
def test_a_request_that_does_not_come_as_a_whole_is_not_waited_for(port: int, sent: bytes) -> None:
    with connect(port) as one:
        one.sendall(sent)
        assert 0.1 < seconds_until_closed(one) < 5


def test_a_trickle_does_not_put_it_off(port: int) -> None:
    with connect(port) as one:
        start = time.monotonic()
        with suppress(ConnectionError):
            while time.monotonic() - start < 8:
                one.sendall(b"a")
                time.sleep(0.05)
        assert time.monotonic() - start < 5


def test_one_address_cannot_take_all_places(patient: int) -> None:
    with ExitStack() as stack:
        for _ in range(PATIENT.connections_per_address):
            stack.enter_context(connect(patient))
        assert not is_served(patient)
        assert is_served(patient, "127.0.0.2")
    until(lambda: is_served(patient), "its places are free again")


def test_many_addresses_together_cannot_take_all_places(patient: int) -> None:
    crowd = [f"127.0.1.{n}" for n in range(1, 7)]
    with ExitStack() as stack:
        for sender in 3 * crowd:
            stack.enter_context(connect(patient, sender))
        assert is_served(patient, "127.0.0.2")


@pytest.mark.long
def test_an_answer_that_is_not_taken_is_not_waited_for(port: int, tmp_path: Path) -> None:
    (tmp_path / "placements.json").write_bytes(b" " * 30_000_000)
    with socket.socket() as one:
        one.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        one.connect(("127.0.0.1", port))
        one.sendall(REQUEST.replace(b"mosaic", b"placements"))
        time.sleep(3 * HASTY.answer_s)
        one.settimeout(10)
        received = 0
        with suppress(ConnectionError):
            while data := one.recv(1 << 20):
                received += len(data)
        assert received < 30_000_000
    assert is_served(port)


def test_places_are_kept_for_this_machine() -> None:
    places = AddressQuota(10, 3)
    assert [places.take(f"10.0.0.{n}") for n in range(9)] == [True] * 7 + [False] * 2
    assert [places.take("127.0.0.1") for _ in range(4)] == [True] * 3 + [False]
    places.leave("10.0.0.1")
    assert [places.take("10.0.0.9") for _ in range(2)] == [True, False]
    places.leave("127.0.0.1")
    assert not places.take("10.0.0.9")
    assert places.take("127.0.0.2")


def test_who_has_most_makes_room_but_this_machine_for_nobody_else() -> None:
    places = AddressQuota(10, 4)
    for origin, count in (("10.0.0.1", 4), ("10.0.0.2", 2), ("127.0.0.1", 4)):
        assert [places.take(origin) for _ in range(count)] == [True] * count
    assert not places.take("10.0.0.3")
    assert places.greediest("10.0.0.3") == places.greediest("10.0.0.2") == "10.0.0.1"
    places.leave("10.0.0.1")
    assert places.greediest("10.0.0.2") is None
    assert places.greediest("127.0.0.2") == "127.0.0.1"


@pytest.mark.parametrize(
    ("remote", "origin"),
    [
        ("10.0.0.7", "10.0.0.7"),
        ("::ffff:127.0.0.1", "127.0.0.1"),
        ("::1", "::1"),
        ("fe80::1%eth0", "fe80::/64"),
        ("2001:db8::1:2:3:4", "2001:db8::/64"),
        ("", ""),
        (None, ""),
    ],
)
def test_whoever_has_an_ipv6_network_counts_once(remote: str | None, origin: str) -> None:
    assert origin_of(remote) == origin


MALFORMED = {
    "both lengths": b"POST / HTTP/1.1\r\nHost: a\r\nContent-Length: 1\r\nTransfer-Encoding: chunked\r\n\r\n",
    "many headers": b"GET / HTTP/1.1\r\n" + b"".join(b"a%d: b\r\n" % n for n in range(200)) + b"\r\n",
    "long line": b"GET /" + b"a" * 100_000 + b" HTTP/1.1\r\n\r\n",
    "noise": bytes(range(256)) * 4,
    "TLS": bytes.fromhex("16030100f5010000f1030300") + b"\0" * 200,
    "line ends": b"\r\n" * 1000,
}


@pytest.mark.parametrize("sent", MALFORMED.values(), ids=MALFORMED)
def test_what_cannot_be_read_costs_a_line_at_most(
    port: int, sent: bytes, caplog: pytest.LogCaptureFixture, capfd: pytest.CaptureFixture[str]
) -> None:
    for _ in range(2):
        said = answer(port, sent)
        assert re.match(rb"HTTP/1\.[01] 40[03] ", said) or (said == b"" and sent.strip() == b"")
        assert b"nosniff" in said or not said
        assert b"aiohttp" not in said
    assert not [record for record in caplog.records if record.exc_info and record.levelno >= logging.WARNING]
    assert capfd.readouterr() == ("", "")
    assert is_served(port)


def test_connections_that_are_reset_are_no_news(port: int, caplog: pytest.LogCaptureFixture) -> None:
    for sent in (b"", b"GET", REQUEST, REQUEST * 5):
        with connect(port) as one:
            one.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")
            one.sendall(sent)
    until(lambda: is_served(port), "served")
    assert not [record for record in caplog.records if record.levelno >= logging.WARNING]


def test_a_line_of_code_is_heard_once_a_minute_however_often_it_logs() -> None:
    heard: list[str] = []
    logger = logging.getLogger("sparing test")
    logger.addHandler(SparingHandler(lambda text, level: heard.append(text)))
    logger.propagate = False
    for number in range(1000):
        logger.warning("again %d", number)
    logger.warning("another")
    assert heard == ["again 0", "another"]


def test_without_a_file_left_nobody_is_let_in_and_nothing_is_said_a_thousand_times(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    tries = []

    def no_file(self: socket.socket) -> None:
        tries.append(self)
        raise OSError(24, "Too many open files")

    server = WebServer(tmp_path, HttpAddress("127.0.0.1", 0), Feed())
    server.start()
    monkeypatch.setattr(socket.socket, "accept", no_file)
    with connect(server.port):
        until(lambda: tries, "a connection was to be accepted")
        time.sleep(0.4)
    assert len(tries) < 4
    server.stop()


def test_a_name_with_two_addresses_has_one_port() -> None:
    sockets = listening("localhost", 0)
    try:
        assert len({one.getsockname()[1] for one in sockets}) == 1
    finally:
        for one in sockets:
            one.close()


@pytest.mark.parametrize("steps", range(6))
def test_who_knocks_as_it_ends_is_not_forgotten(steps: int, recwarn: pytest.WarningsRecorder) -> None:
    """After so many steps of the event loop; of a connection that nobody closes Python warns."""

    async def answer_nothing(_: web.BaseRequest) -> web.Response:
        return web.Response()

    async def knock() -> None:
        page = web.Server(answer_nothing)
        listener = PageListener(page, PATIENT, None)
        port = await listener.open("127.0.0.1", 0)
        await asyncio.sleep(0)
        with connect(port):
            for _ in range(steps):
                await asyncio.sleep(0)
            await listener.close()
            await page.shutdown(0.05)

    asyncio.run(knock())
    gc.collect()
    assert not [told for told in recwarn if told.category is ResourceWarning]


def test_who_shakes_no_hands_over_https_is_not_waited_for(tmp_path: Path, certificate: Path) -> None:
    settings = WebSettings(request_s=0.3, certificate=str(certificate))
    server = WebServer(tmp_path, HttpAddress("127.0.0.1", 0), Feed(), settings=settings)
    assert server.start().startswith("https://")
    with connect(server.port) as one:
        one.sendall(b"\x16\x03")
        assert seconds_until_closed(one) < 5
    context = ssl.create_default_context(cafile=str(certificate))
    with connect(server.port) as one, context.wrap_socket(one, server_hostname="127.0.0.1") as secured:
        secured.sendall(b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
        assert secured.recv(100).startswith(b"HTTP/1.1 200")
    server.stop()


@pytest.mark.parametrize(
    "sent", [b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n", bytes(range(256)) * 40, b"\x16\x03\x01\xff\xff"]
)
def test_what_is_no_handshake_ends_that_connection_alone(
    tmp_path: Path, certificate: Path, sent: bytes, caplog: pytest.LogCaptureFixture
) -> None:
    """Plain HTTP, noise, a handshake that claims more than there is."""
    settings = WebSettings(request_s=0.3, certificate=str(certificate))
    server = WebServer(tmp_path, HttpAddress("127.0.0.1", 0), Feed(), settings=settings)
    server.start()
    for _ in range(3):
        with connect(server.port) as one:
            one.sendall(sent)
            assert seconds_until_closed(one) < 5
    context = ssl.create_default_context(cafile=str(certificate))
    with connect(server.port) as one, context.wrap_socket(one, server_hostname="127.0.0.1") as secured:
        secured.sendall(b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
        assert secured.recv(100).startswith(b"HTTP/1.1 200")
    server.stop()
    assert "Traceback" not in caplog.text
