"""A flight with known ground on a server."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from gcs_mosaic.views import flight_view
from gcs_mosaic.web.address import HttpAddress
from gcs_mosaic.web.feed import Feed
from gcs_mosaic.web.server import WebServer
from tests.web.maps.anchored_flight import AnchoredFlight
from tests.web.test_notes_api import Writer


@pytest.fixture
def fresh_tables(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(flight_view, "LEAST_REST_S", 0.0)
    monkeypatch.setattr(flight_view, "REST", 0.0)


@pytest.fixture(scope="session")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A flight whose tiles the others take over: they take half a second to draw."""
    return AnchoredFlight(tmp_path_factory.mktemp("drawn")).root


@pytest.fixture
def flight(tmp_path: Path, fresh_tables: None, drawn: Path) -> AnchoredFlight:
    root = tmp_path / "small"
    root.mkdir()
    return AnchoredFlight(root, drawn=drawn)


@pytest.fixture
def feed() -> Feed:
    return Feed()


@pytest.fixture
def client(flight: AnchoredFlight, feed: Feed) -> Iterator[Writer]:
    """Of a server at this machine; the flight has no anchor yet."""
    server = WebServer(flight.root, HttpAddress("127.0.0.1", 0), feed)
    yield Writer(server.start())
    server.stop()


@pytest.fixture
def pinned(client: Writer, flight: AnchoredFlight) -> Writer:
    """... which has one."""
    flight.set_pins(client)
    return client
