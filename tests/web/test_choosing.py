"""The aircraft chosen on the page: by whom, and what becomes of it."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from gcs_mosaic.store.requests import REQUEST_NAME, Answer, answer, take_request
from gcs_mosaic.web import choosing
from gcs_mosaic.web.address import HttpAddress
from gcs_mosaic.web.server import WebServer
from gcs_mosaic.web.settings import WebSettings
from gcs_mosaic.web.token import Access
from tests.running import until
from tests.web.small_flight import SmallFlight
from tests.web.test_access import lan_address
from tests.web.test_app import Client

TOKEN = "abcdefgh23456789"


@contextmanager
def served(flight: Path, host: str = "127.0.0.1", who: Access | None = None) -> Iterator[Client]:
    server = WebServer(flight, HttpAddress(host, 0), access=who, settings=WebSettings())
    try:
        yield Client(server.start())
    finally:
        server.stop()


def from_the_network(client: Client) -> Client:
    """As another machine asks: from an address of the network."""
    return Client(f"http://{lan_address()}:{client.netloc.partition(':')[2]}/")


@pytest.fixture
def flight(tmp_path: Path) -> Path:
    SmallFlight(tmp_path).write()
    return tmp_path


def answering(flight: Path, taken: bool) -> threading.Thread:
    """The daemon, which answers one request."""

    def look() -> None:
        request = until(lambda: take_request(flight), "asked")
        answer(flight, Answer(id=request.id, taken=taken, text=f"system {request.vehicle}"))

    thread = threading.Thread(target=look)
    thread.start()
    return thread


@pytest.mark.parametrize(("taken", "status"), [(True, 200), (False, 409)])
def test_the_flight_is_asked_and_its_answer_is_told(flight: Path, taken: bool, status: int) -> None:
    with served(flight) as client:
        thread = answering(flight, taken)
        response, told = client.ask("/vehicle/3", "POST")
        thread.join()
    assert (response.status, told) == (status, b"system 3\n")


def test_a_flight_that_does_not_answer_is_said_so(flight: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(choosing, "ANSWER_S", 0.3)
    with served(flight) as client:
        assert client.status("/vehicle/3", "POST") == 504
    assert not (flight / REQUEST_NAME).exists()


@pytest.mark.parametrize("path", ["/vehicle/0", "/vehicle/256", "/vehicle/x", "/vehicle/1000", "/vehicle/"])
def test_only_what_can_be_an_aircraft_is_asked_for(flight: Path, path: str) -> None:
    with served(flight) as client:
        assert client.status(path, "POST") == 404


def test_another_page_cannot_choose(flight: Path) -> None:
    with served(flight) as client:
        assert client.status("/vehicle/3", "POST", Origin="http://evil.example") == 403
        assert client.status("/vehicle/3") == 405
    assert not (flight / REQUEST_NAME).exists()


def test_another_machine_needs_the_token_even_where_everybody_may_look(flight: Path) -> None:
    with served(flight, "0.0.0.0", Access(is_open=True)) as here:
        client = from_the_network(here)
        assert client.status("/mosaic.json") == 200
        assert client.status("/vehicle/3", "POST") == 403
        assert not (flight / REQUEST_NAME).exists()
    with served(flight, "0.0.0.0", Access(token=TOKEN)) as here:
        client = from_the_network(here)
        assert client.status("/vehicle/3", "POST") == 401
        assert not (flight / REQUEST_NAME).exists()
        thread = answering(flight, taken=True)
        assert client.status("/vehicle/3", "POST", Authorization=f"Bearer {TOKEN}") == 200
        thread.join()
