from __future__ import annotations

import http.client
import json
import re
import socket
import threading
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from pathlib import Path
from urllib.parse import quote

import pytest

from gcs_mosaic.errors import UsageError
from gcs_mosaic.render.tile_grid import Tile
from gcs_mosaic.web import app as app_module
from gcs_mosaic.web import documents as documents_module
from gcs_mosaic.web import live as live_module
from gcs_mosaic.web import recent_answers
from gcs_mosaic.web.address import HttpAddress
from gcs_mosaic.web.feed import Feed
from gcs_mosaic.web.server import WebServer
from gcs_mosaic.web.settings import WebSettings
from tests.running import until
from tests.web.small_flight import MIDDLE, RED, SmallFlight

TILE = Tile(16, MIDDLE, MIDDLE)
TILE_URL = f"/tiles/0/16/{MIDDLE}/{MIDDLE}"


class Client:
    """Plain HTTP to one server, nothing tidied on the way."""

    def __init__(self, url: str) -> None:
        self.netloc = url.split("/")[2]

    def ask(self, path: str, method: str = "GET", **headers: str) -> tuple[http.client.HTTPResponse, bytes]:
        connection = http.client.HTTPConnection(self.netloc, timeout=5)
        try:
            connection.request(method, path, headers=headers)
            answer = connection.getresponse()
            return answer, answer.read()
        finally:
            connection.close()

    def status(self, path: str, method: str = "GET", **headers: str) -> int:
        return self.ask(path, method, **headers)[0].status


class Live:
    """An open /live."""

    def __init__(self, client: Client) -> None:
        self._connection = http.client.HTTPConnection(client.netloc, timeout=5)
        self._connection.request("GET", "/live")
        self.answer = self._connection.getresponse()

    def line(self) -> str:
        while not (line := self.answer.readline().decode()).strip():
            if not line:
                return "end"
        return line.strip()

    def message(self) -> dict[str, object]:
        message: dict[str, object] = json.loads(self.line().removeprefix("data: "))
        return message

    def close(self) -> None:
        self.answer.close()
        self._connection.close()


@pytest.fixture
def flight(tmp_path: Path) -> SmallFlight:
    return SmallFlight(tmp_path)


@pytest.fixture
def client(tmp_path: Path, feed: Feed) -> Iterator[Client]:
    server = WebServer(tmp_path, HttpAddress("127.0.0.1", 0), feed)
    yield Client(server.start())
    server.stop()


def test_page_and_its_parts_are_served(client: Client) -> None:
    answer, body = client.ask("/")
    assert answer.status == 200
    assert b"/viewer/page.js" in body
    for path in (
        "page.js",
        "start.js",
        "viewer.js",
        "viewer.css",
        "vendor/leaflet/leaflet.js",
        "vendor/leaflet/LICENSE",
    ):
        assert client.status(f"/viewer/{path}") == 200


def test_browser_is_told_to_trust_nobody_else(client: Client) -> None:
    answer, _ = client.ask("/")
    policy = answer.headers["Content-Security-Policy"]
    assert policy.startswith("default-src 'self';")
    assert "unsafe" not in policy
    assert answer.headers["X-Content-Type-Options"] == "nosniff"


def test_documents_are_as_on_disk_and_never_cached(client: Client, flight: SmallFlight) -> None:
    assert client.status("/mosaic.json") == 404
    flight.write()
    answer, body = client.ask("/mosaic.json")
    assert body == (flight.root / "mosaic.json").read_bytes()
    assert answer.headers["Content-Type"] == "application/json"
    assert answer.headers["Cache-Control"] == "no-cache"


def test_what_is_new_of_frames_is_told_since_a_revision(client: Client, flight: SmallFlight) -> None:
    assert client.status("/placements.jsonl") == 404
    for name in ("a.jpg", "b.jpg"):
        flight.place(name, 0, 0)
        flight.write()
    answer, body = client.ask("/placements.jsonl?after=1")
    assert answer.headers["Content-Type"] == "application/x-ndjson"
    head, *lines = map(json.loads, body.splitlines())
    assert (head["since"], [line["newest"] for line in lines]) == (0, ["b.jpg"])
    assert client.ask("/placements.jsonl")[1] == (flight.root / "placements.jsonl").read_bytes()
    for after in ("", "-1", "x", "1" * 5000, "²"):
        assert client.status(f"/placements.jsonl?after={quote(after)}") == 400


def test_a_part_of_a_large_document_can_be_asked_for(
    client: Client, flight: SmallFlight, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(documents_module, "SMALL_BYTES", 10)
    flight.write()
    whole = (flight.root / "mosaic.json").read_bytes()
    answer, part = client.ask("/mosaic.json", Range="bytes=2-9")
    assert (answer.status, part) == (206, whole[2:10])
    assert client.status("/mosaic.json", Range=f"bytes={len(whole)}-") == 416
    assert client.status("/mosaic.json", **{"If-Match": '"another"'}) == 412


def test_tile_is_served_with_and_without_its_ending(client: Client, flight: SmallFlight) -> None:
    flight.paint(TILE, RED)
    plain, ended = client.ask(TILE_URL), client.ask(TILE_URL + ".jpg")
    assert plain[0].headers["Content-Type"] == "image/jpeg"
    assert plain[1] == ended[1] == (flight.root / f"tiles/0/16/{MIDDLE}/{MIDDLE}.jpg").read_bytes()


def test_known_tile_is_not_sent_again(client: Client, flight: SmallFlight, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recent_answers, "KEPT_S", 0.0)  # nobody tells here that it was painted
    flight.paint(TILE, RED)
    etag = client.ask(TILE_URL)[0].headers["ETag"]
    answer, body = client.ask(TILE_URL, **{"If-None-Match": etag})
    assert (answer.status, body) == (304, b"")
    flight.paint(TILE, (1, 2, 3))
    assert client.status(TILE_URL, **{"If-None-Match": etag}) == 200


def test_tile_that_nobody_saw_is_transparent(client: Client) -> None:
    answer, body = client.ask("/tiles/0/16/1/1")
    assert (answer.status, answer.headers["Content-Type"]) == (200, "image/png")
    assert body.startswith(b"\x89PNG")


@pytest.mark.parametrize(
    "path",
    [
        "/tiles/0/25/0/0",
        "/tiles/0/3/8/0",
        "/tiles/0/3/0/-1",
        "/tiles/9999999/0/0/0",
        "/tiles/0/0/0/0/0",
        "/tiles/0/16/../../flight.sqlite",
        "/tiles/",
        "/flight.sqlite",
        "/frames/a.jpg",
        "/viewer/",
        "/viewer/../app.py",
        "/viewer/..%2fapp.py",
        "/viewer/%2e%2e/app.py",
        "/viewer//etc/passwd",
        "/..%2f..%2fetc/passwd",
        "/mosaic.json/",
    ],
)
def test_everything_else_is_not_there(client: Client, flight: SmallFlight, path: str) -> None:
    flight.write()
    (flight.root / "flight.sqlite").write_bytes(b"secret")
    answer, body = client.ask(path)
    assert answer.status in (403, 404)
    assert b"secret" not in body
    assert b"import" not in body


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "PATCH", "OPTIONS"])
def test_nothing_can_be_changed(client: Client, method: str) -> None:
    assert client.status("/mosaic.json", method) == 405


def test_foreign_host_name_is_refused(client: Client) -> None:
    assert client.status("/", Host="evil.example") == 403
    assert client.status("/live", Host="evil.example:8470") == 403
    assert client.status("/", Host="localhost:1") == 200


def test_live_tells_the_revision_and_then_each_change(client: Client, feed: Feed, flight: SmallFlight) -> None:
    flight.write()
    live = Live(client)
    assert live.answer.headers["Content-Type"] == "text/event-stream"
    assert live.message() == {"revision": 1, "tiles": None}
    threading.Thread(target=feed.publish, args=(2, [(0, TILE), (0, TILE.parent)])).start()
    assert live.message() == {"revision": 2, "tiles": [[0, *TILE]]}
    live.close()


def test_live_beats_while_nothing_happens(client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live_module, "HEARTBEAT_S", 0.05)
    live = Live(client)
    live.message()
    assert [live.line(), live.line()] == ["event: alive", "data: {}"]
    live.close()


def test_pages_are_counted(tmp_path: Path) -> None:
    settings = WebSettings(pages=4, pages_per_address=2)
    server = WebServer(tmp_path, HttpAddress("127.0.0.1", 0), Feed(), settings=settings)
    client = Client(server.start())
    pages = [Live(client) for _ in range(2)]
    assert [page.message()["revision"] for page in pages] == [0, 0]
    assert client.status("/live") == 503
    pages.pop().close()
    until(lambda: is_told(client), "a place is free again", 5)  # long before a heartbeat would tell
    pages.pop().close()
    server.stop()


def is_told(client: Client) -> bool:
    """Whether there is a place for one more page."""
    live = Live(client)
    live.close()
    return live.answer.status == 200


def test_saved_flight_is_polled(flight: SmallFlight, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(app_module, "POLL_S", 0.05)
    flight.write()
    server = WebServer(flight.root, HttpAddress("127.0.0.1", 0))
    live = Live(Client(server.start()))
    assert live.message()["revision"] == 1
    flight.write()
    assert live.message() == {"revision": 2, "tiles": None}
    server.stop()
    assert [live.line() for _ in range(3)] == ["event: ended", "data: {}", "end"]
    live.close()


def test_port_that_is_taken_is_said_with_a_way_out(client: Client, tmp_path: Path) -> None:
    port = int(client.netloc.split(":")[1])
    with pytest.raises(UsageError, match=f"listens on 127.0.0.1:{port} already: choose --http 127.0.0.1:[0-9]+,"):
        WebServer(tmp_path, HttpAddress("127.0.0.1", port)).start()


def test_the_port_that_is_proposed_is_free(client: Client, tmp_path: Path) -> None:
    port = int(client.netloc.split(":")[1])
    with ExitStack() as stack:
        with suppress(OSError):  # another program has it: as well
            stack.enter_context(socket.create_server(("127.0.0.1", port + 1)))
        with pytest.raises(UsageError) as refused:
            WebServer(tmp_path, HttpAddress("127.0.0.1", port)).start()
    proposed = re.search(r"choose --http 127\.0\.0\.1:(\d+),", str(refused.value))
    assert proposed is not None
    assert int(proposed[1]) > port + 1
    socket.create_server(("127.0.0.1", int(proposed[1]))).close()


def test_address_of_another_machine_is_said(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"192\.0\.2\.1:8470 is not an address of this machine"):
        WebServer(tmp_path, HttpAddress("192.0.2.1", 8470)).start()


def test_stopping_twice_and_starting_again_on_the_same_port(tmp_path: Path) -> None:
    server = WebServer(tmp_path, HttpAddress("127.0.0.1", 0))
    port = int(server.start().split(":")[2].strip("/"))
    server.stop()
    server.stop()
    again = WebServer(tmp_path, HttpAddress("127.0.0.1", port))
    assert Client(again.start()).status("/") == 200
    again.stop()
