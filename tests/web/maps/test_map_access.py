"""Who may see the map elsewhere: the token in the address, and reading the map only; pages of other sites by the settings."""

from __future__ import annotations

import json
import logging
import socket
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from gcs_mosaic.web import access as module
from gcs_mosaic.web.address import HttpAddress
from gcs_mosaic.web.feed import Feed
from gcs_mosaic.web.maps import served_map
from gcs_mosaic.web.server import WebServer
from gcs_mosaic.web.settings import WebSettings
from gcs_mosaic.web.token import Access, without_token
from tests.web.maps.anchored_flight import FLIGHT, AnchoredFlight, laid_at
from tests.web.test_notes_api import Writer

TOKEN = "abcdefgh23456789"
BASE = f"/maps/{FLIGHT}"
MAPS = (f"{BASE}/3/1/1.png", f"{BASE}/tilejson.json", f"{BASE}/wms", f"{BASE}/map.kml", f"{BASE}/gcs-mosaic.zip")
OTHERS = (
    "/",
    "/mosaic.json",
    "/status.json",
    "/tiles/0/0/0/0",
    "/live",
    "/api/v1/anchors",
    "/api/v1/finds.kml",
    "/mapsx",
)


@dataclass
class Served:
    client: Writer
    port: int

    def status(self, path: str, method: str = "GET", **headers: str) -> int:
        return self.client.status(path, method, **headers)


@pytest.fixture
def served(flight: AnchoredFlight) -> Iterator[Served]:
    server = WebServer(flight.root, HttpAddress("0.0.0.0", 0), Feed(), access=Access(token=TOKEN))
    client = Writer(server.start())
    flight.set_pins(client)
    yield Served(client, server.port)
    server.stop()


@pytest.fixture
def stranger(served: Served, monkeypatch: pytest.MonkeyPatch) -> Served:
    monkeypatch.setattr(module, "is_loopback", lambda origin: False)
    return served


def test_a_program_reads_the_map_with_the_token_in_its_address(stranger: Served) -> None:
    for path in MAPS:
        assert stranger.status(path) == 401
        assert stranger.status(f"{path}?token={TOKEN}") == 200, path
        assert stranger.status(path, Authorization=f"Bearer {TOKEN}") == 200
        assert stranger.status(path, Cookie=f"gcs-mosaic-{stranger.port}={TOKEN}") == 200


def test_a_token_in_the_address_opens_nothing_but_the_map_and_only_for_reading(stranger: Served) -> None:
    for path in OTHERS[1:]:
        assert stranger.status(f"{path}?token={TOKEN}") == 401, path
    for method in ("POST", "PUT", "DELETE", "HEAD", "PATCH", "OPTIONS"):
        assert stranger.status(f"{MAPS[0]}?token={TOKEN}", method) == 401, method
    assert stranger.status(f"/maps/../mosaic.json?token={TOKEN}") in (401, 404)
    assert stranger.status(f"/maps/%2e%2e/mosaic.json?token={TOKEN}") in (401, 404)


def test_guessing_is_limited_as_elsewhere_and_an_old_link_shuts_nobody_out(stranger: Served) -> None:
    old = [stranger.status(f"{MAPS[0]}?token=zzzzzzzz22222222") for _ in range(3 * module.TRIES)]
    assert set(old) == {401}
    assert stranger.status(f"{MAPS[0]}?token={TOKEN}") == 200
    tried = [stranger.status(f"{MAPS[0]}?token={n:016}") for n in range(module.TRIES + 2)]
    assert tried[-2:] == [429] * 2
    assert stranger.status(f"{MAPS[0]}?token={TOKEN}") == 429
    assert stranger.status(MAPS[0], Cookie=f"gcs-mosaic-{stranger.port}={TOKEN}") == 200


@pytest.mark.long
def test_addresses_in_documents_bear_the_token_that_was_given_and_no_other(stranger: Served) -> None:
    told = json.loads(stranger.client.ask(f"{BASE}/tilejson.json?token={TOKEN}")[1])
    assert told["tiles"][0].endswith(f"/{{z}}/{{x}}/{{y}}.png?token={TOKEN}")
    with_cookie = stranger.client.ask(f"{BASE}/tilejson.json", Cookie=f"gcs-mosaic-{stranger.port}={TOKEN}")[1]
    assert TOKEN not in with_cookie.decode()
    both = stranger.client.ask(f"{BASE}/wms?REQUEST=GetCapabilities&token={TOKEN}&VERSION=1.1.1")[1].decode()
    assert f"/wms?token={TOKEN}&amp;" in both


@pytest.mark.long
def test_the_token_is_in_no_log(
    stranger: Served, flight: AnchoredFlight, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    caplog.set_level(logging.INFO)  # what the page's process passes on
    level = flight.laid.levels[1]
    column, row = laid_at(flight.laid, level)
    good = f"{BASE}/{level}/{column}/{row}.png?token={TOKEN}"
    assert stranger.status(good) == 200
    stranger.status(f"{BASE}/{level}/{column}/{row}.exe?token={TOKEN}")
    for line in (f"GET {good} HTTP/9.9.9", f"GET {good}\x01 HTTP/1.1", f"GE\x02T {good} HTTP/1.1", f"GET {good}"):
        with socket.create_connection(("127.0.0.1", stranger.port), 5) as one:
            one.sendall(f"{line}\r\nHost: 127.0.0.1\r\n\r\n".encode())
            one.settimeout(2)
            assert one.recv(65536)

    def broken(*_given: object) -> None:
        raise RuntimeError("on purpose")

    monkeypatch.setattr(served_map, "encoded_tile", broken)
    assert stranger.status(f"{BASE}/{level}/{column + 1}/{row}.png?token={TOKEN}") == 500
    assert "on purpose" in caplog.text
    assert "a request cannot be read" in caplog.text
    assert TOKEN not in caplog.text
    assert without_token(f"b'GET /x?a=1&token={TOKEN}&b=2 HTTP/1.1'") == "b'GET /x?a=1&token=…&b=2 HTTP/1.1'"
    assert all(TOKEN not in path.read_text("utf-8", "replace") for path in flight.root.glob("*.json*"))


def test_pages_of_other_sites_are_let_in_by_the_settings_only(flight: AnchoredFlight) -> None:
    for cors in (False, True):
        server = WebServer(flight.root, HttpAddress("127.0.0.1", 0), Feed(), settings=WebSettings(cors=cors))
        client = Writer(server.start())
        for path in (*MAPS, f"{BASE}/99/0/0.png"):
            headers = client.ask(path, Origin="http://maps.example")[0].headers
            assert headers.get("Access-Control-Allow-Origin") == ("*" if cors else None)
            assert headers["Cross-Origin-Resource-Policy"] == ("cross-origin" if cors else "same-origin")
            assert headers["X-Content-Type-Options"] == "nosniff"
        for path in OTHERS[:-1]:
            if path != "/live":
                headers = client.ask(path, Origin="http://maps.example")[0].headers
                assert headers.get("Access-Control-Allow-Origin") is None
                assert headers["Cross-Origin-Resource-Policy"] == "same-origin"
        server.stop()


def test_a_foreign_host_name_is_refused_here_too(served: Served) -> None:
    assert served.status(MAPS[0], Host="maps.evil.example") == 403


def test_where_everybody_may_look_no_token_is_needed_nor_told(
    flight: AnchoredFlight, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(module, "is_loopback", lambda origin: False)
    server = WebServer(flight.root, HttpAddress("0.0.0.0", 0), Feed(), access=Access(is_open=True))
    client = Writer(server.start())
    assert client.status(MAPS[0]) == 200
    assert b"token" not in client.ask(f"{BASE}/tilejson.json?token=x")[1]
    server.stop()
