"""Finds, scale, reviews and dismissed hints over HTTP: shared live, checked, and kept through kills."""

from __future__ import annotations

import http.client
import json
import os
import signal
import sqlite3
import subprocess
import sys
import time
from codecs import BOM_UTF8
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from gcs_mosaic.notes.finds.finds import Finds
from gcs_mosaic.notes.storage.book import NotesBook
from gcs_mosaic.store.folder import NOTES_NAME
from gcs_mosaic.web.address import HttpAddress
from gcs_mosaic.web.api import notes as notes_module
from gcs_mosaic.web.feed import Feed
from gcs_mosaic.web.hint_keeper import HintKeeper
from gcs_mosaic.web.server import WebServer
from gcs_mosaic.web.token import Access
from tests.notes.mapped import MappedFlight
from tests.running import until
from tests.web.served import served
from tests.web.test_access import lan_address
from tests.web.test_app import Client, Live

API = "/api/v1"
HERE = {"island": 0, "x": 20.0, "y": 30.0, "who": "Kim", "kind": "tent", "label": "blue tent", "note": "by the\ncreek"}


class Writer(Client):
    """Sends and gets JSON."""

    def send(self, method: str, path: str, body: Any = None, **headers: str) -> tuple[int, Any]:
        connection = http.client.HTTPConnection(self.netloc, timeout=5)
        try:
            text = body if isinstance(body, bytes) else json.dumps(body).encode()
            connection.request(method, API + path, text if body is not None else None, headers)
            answer = connection.getresponse()
            data = answer.read()
            is_json = answer.headers.get_content_type() == "application/json"
            return answer.status, json.loads(data) if is_json else data.decode()
        finally:
            connection.close()

    def get(self, path: str) -> Any:
        status, told = self.send("GET", path)
        assert status == 200, told
        return told


@pytest.fixture
def flight(tmp_path: Path) -> MappedFlight:
    root = tmp_path / "flight"
    root.mkdir()
    return MappedFlight(root)


@pytest.fixture
def client(flight: MappedFlight) -> Iterator[Writer]:
    server = WebServer(flight.root, HttpAddress("127.0.0.1", 0), Feed())
    yield Writer(server.start())
    server.stop()


def test_a_find_is_set_edited_deleted_and_restored(client: Writer) -> None:
    status, made = client.send("POST", "/finds", HERE)
    assert (status, made["revision"], made["frame"]["name"], made["follows"]) == (201, 1, "a.jpg", True)
    assert abs(made["created_utc"] - time.time()) < 60
    path = f"/finds/{made['id']}"
    status, edited = client.send("PATCH", path, {"revision": 1, "note": "two people", "who": "Lou"})
    assert (status, edited["note"], edited["label"], edited["changed_by"]) == (200, "two people", "blue tent", "Lou")
    status, newest = client.send("PATCH", path, {"revision": 1, "note": "mine", "who": "Kim"})
    assert (status, newest) == (409, edited)
    assert client.send("PATCH", path, {"note": "mine", "who": "Kim"})[0] == 428
    status, deleted = client.send("DELETE", path, {"who": "Kim"}, **{"If-Match": '"2"'})
    assert (status, deleted["deleted"], client.get("/finds")["finds"]) == (200, True, [])
    assert [one["id"] for one in client.get("/finds?deleted=1")["finds"]] == [made["id"]]
    assert client.send("POST", f"{path}/restore", {"revision": 3, "who": "Kim"})[0] == 200
    assert [one["note"] for one in client.get("/finds")["finds"]] == ["two people"]
    status, moved = client.send("PATCH", path, {"revision": 4, "frame": 3, "pixel": [100, 50], "who": "Kim"})
    assert (status, moved["island"], moved["in_original"], moved["frame"]["number"]) == (200, 1, True, 3)


def test_sent_again_it_makes_no_second_find(client: Writer) -> None:
    first, second = (client.send("POST", "/finds", {**HERE, "key": "k1"})[1] for _ in range(2))
    assert first == second
    assert len(client.get("/finds")["finds"]) == 1


UNFIT: list[dict[str, Any]] = [
    {"who": ""},
    {"who": None},
    {"note": "x" * 4001},
    {"label": 3},
    {"x": None},
    {"x": 1e300},
    {"island": True},
    {"island": -1},
    {"island": None},
    {"frame": 99, "pixel": [1, 1]},
    {"frame": 1, "pixel": [1]},
    {"frame": 1, "pixel": [-1, 1]},
]
NO_OBJECTS = [b"", b"[]", b"{", b'{"x": NaN, "y": 1, "island": 0, "who": "a"}', b"[" * 50_000]


def test_what_is_unfit_is_refused_in_a_sentence(client: Writer) -> None:
    answers = [client.send("POST", "/finds", {**HERE, **change}) for change in UNFIT]
    assert [(status, said[-2:]) for status, said in answers] == [(400, ".\n")] * len(UNFIT)
    assert [client.send("POST", "/finds", body)[0] for body in NO_OBJECTS] == [400] * len(NO_OBJECTS)
    assert client.get("/finds")["finds"] == []


def test_the_description_is_served(client: Writer) -> None:
    paths = client.get("/openapi.json")["paths"]
    assert set(paths[f"{API}/finds/{{id}}"]) == {"parameters", "get", "patch", "delete"}


def test_a_body_that_is_too_large_is_refused(client: Writer) -> None:
    assert client.send("POST", "/finds", {**HERE, "more": "x" * 70_000})[0] == 413


def test_what_is_not_there_is_said_so(client: Writer) -> None:
    assert client.send("GET", "/finds/7")[0] == 404
    assert client.send("DELETE", "/finds/7", {"who": "Kim", "revision": 1})[0] == 404
    assert client.send("DELETE", "/scale/7")[0] == 404
    assert client.send("DELETE", "/hints/dismissed/x")[0] == 404


def test_what_is_known_is_not_sent_again(client: Writer) -> None:
    for path in ("/finds", "/scale", "/hints/dismissed"):
        etag = client.ask(API + path)[0].headers["ETag"]
        assert client.status(API + path, **{"If-None-Match": etag}) == 304
        client.send("POST", "/finds", HERE)
        assert client.status(API + path, **{"If-None-Match": etag}) == 200


def test_two_pages_see_each_others_finds_within_a_second(client: Writer, flight: MappedFlight) -> None:
    pages = [Live(client) for _ in range(2)]
    assert {page.message()["tiles"] for page in pages} == {None}
    began = time.monotonic()
    client.send("POST", "/finds", HERE)
    for page in pages:
        assert (page.line(), page.message()) == ("event: notes", {"revision": 1})
    assert time.monotonic() - began < 1.0
    late = Live(client)
    late.message()
    assert (late.line(), late.message()) == ("event: notes", {"revision": 1})
    for page in (*pages, late):
        page.close()


def test_what_another_program_writes_is_told_too(flight: MappedFlight, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(notes_module, "KEEP_S", 0.05)
    with served(flight.root, feed=Feed()) as url:
        client = Writer(url)
        client.send("POST", "/finds", HERE)
        with closing(Live(client)) as page:
            heard = [page.line() for _ in range(3)]
            with closing(NotesBook(flight.root)) as other:
                Finds(other).delete(1, 1, "Lou")
            assert (heard[1:], page.line(), page.message()) == (
                ["event: notes", 'data: {"revision":1}'],
                "event: notes",
                {"revision": 2},
            )
            assert client.get("/finds") == {"revision": 2, "map_revision": 3, "cot": False, "finds": []}


def test_a_file_that_is_deleted_comes_back_before_anybody_asks(
    flight: MappedFlight, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(notes_module, "KEEP_S", 0.05)
    server = WebServer(flight.root, HttpAddress("127.0.0.1", 0), Feed())
    Writer(server.start()).send("POST", "/finds", HERE)
    (flight.root / NOTES_NAME).unlink()
    until((flight.root / NOTES_NAME).exists, "written anew", 5)
    server.stop()


def test_a_scale_is_given_taken_back_and_given_again(client: Writer) -> None:
    ends = {"island": 0, "from": [0, 0], "to": [30, 40], "who": "Kim"}
    assert client.send("POST", "/scale", {**ends, "metres": 10})[0] == 201
    assert client.send("POST", "/scale", {**ends, "metres": 20})[0] == 201
    lengths = [round(client.get("/scale")["islands"][0]["metres_per_unit"], 3)]
    assert client.send("DELETE", "/scale/2")[0] == 200
    lengths.append(round(client.get("/scale")["islands"][0]["metres_per_unit"], 3))
    assert client.send("POST", "/scale/2/restore")[0] == 200
    lengths.append(round(client.get("/scale")["islands"][0]["metres_per_unit"], 3))
    assert lengths == [0.4, 0.2, 0.4]
    for change in ({"metres": 0}, {"metres": "x"}, {"to": [0, 0]}, {"from": 3}, {"island": 1.5}):
        assert client.send("POST", "/scale", {**ends, "metres": 10, **change})[0] == 400


def test_two_review_and_each_is_told_what_is_missing(client: Writer) -> None:
    look = {"island": 1, "box": [-256, -256, 0, 256], "level": 17, "seconds": 1, "who": "Kim"}
    assert client.send("POST", "/reviews", look) == (202, {"cells": 8})
    assert client.send("POST", "/reviews", {**look, "box": [0, -256, 256, 256], "who": "Lou"})[0] == 202
    asked = "/reviews?island=1&left=-256&top=-256&right=256&bottom=256&level=16"
    counts = {}
    for who in ("", "&who=Kim", "&who=Nobody", "&since=4000000000"):
        told = client.get(asked + who)
        counts[who] = len(told["reviewed"]), len(told["missing"])
    assert counts == {"": (16, 0), "&who=Kim": (8, 8), "&who=Nobody": (0, 16), "&since=4000000000": (0, 16)}
    assert [one["who"] for one in told["reviewers"]] == ["Kim", "Lou"]
    for change in ({"box": [0, 0, 0, 1]}, {"box": 3}, {"level": 25}, {"seconds": 11}):
        assert client.send("POST", "/reviews", {**look, **change})[0] == 400
    for query in ("", "?island=x", "?island=0&left=0&top=0&right=nan&bottom=1&level=0"):
        assert client.send("GET", f"/reviews{query}")[0] == 400


def test_reviews_are_written_at_the_end(flight: MappedFlight) -> None:
    server = WebServer(flight.root, HttpAddress("127.0.0.1", 0), Feed())
    look = {"island": 1, "box": [-256, -256, 0, 256], "level": 17, "seconds": 1, "who": "Kim"}
    Writer(server.start()).send("POST", "/reviews", look)
    server.stop()
    book = NotesBook(flight.root)
    assert book.rows("SELECT count(*) AS n FROM reviewed")[0]["n"] == 8
    book.close()


def test_reviews_are_written_before_the_end_waits_for_anybody(
    flight: MappedFlight, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The page's process is killed if it takes too long, as it does while a frame is being searched for hints."""
    written, stop = list[int](), HintKeeper.stop

    def late(keeper: HintKeeper) -> None:
        with closing(sqlite3.connect(flight.root / NOTES_NAME)) as notes:
            written.extend(*notes.execute("SELECT count(*) FROM reviewed"))
        stop(keeper)

    monkeypatch.setattr(HintKeeper, "stop", late)
    server = WebServer(flight.root, HttpAddress("127.0.0.1", 0), Feed())
    client = Writer(server.start())
    client.send("POST", "/finds", HERE)
    client.send("POST", "/reviews", {"island": 1, "box": [-256, -256, 0, 256], "level": 17, "seconds": 1, "who": "Kim"})
    server.stop()
    assert written == [8]


def test_hints_stay_dismissed_until_they_are_brought_back(client: Writer) -> None:
    for _ in range(2):
        assert client.send("POST", "/hints/dismissed", {"hint": "rare:7", "who": "Kim"})[0] == 200
    told = client.get("/hints/dismissed")
    assert (told["revision"], [one["hint"] for one in told["dismissed"]]) == (1, ["rare:7"])
    assert client.send("DELETE", "/hints/dismissed/rare:7")[0] == 200
    assert client.get("/hints/dismissed")["dismissed"] == []
    assert client.send("POST", "/hints/dismissed", {"hint": "a b", "who": "Kim"})[0] == 400


def test_exports_are_served(client: Writer) -> None:
    client.send("POST", "/finds", {**HERE, "label": "<b>=1"})
    kinds = {"geojson": "application/geo+json", "csv": "text/csv", "html": "text/html"}
    kinds["kml"] = "application/vnd.google-earth.kml+xml"
    for kind, media_type in kinds.items():
        answer, body = client.ask(f"{API}/finds.{kind}")
        assert (answer.status, answer.headers.get_content_type()) == (200, media_type)
        assert b"=1" in body
        assert body.startswith(BOM_UTF8) is (kind == "csv")
        if kind == "html":
            assert answer.headers["Content-Security-Policy"].startswith("default-src 'none'; img-src data:; style-src")
            assert b"<b>=1" not in body


def test_another_site_writes_nothing_and_who_may_only_look_does_not_either(
    client: Writer, flight: MappedFlight
) -> None:
    assert client.send("POST", "/finds", HERE, Origin="http://evil.example")[0] == 403
    server = WebServer(flight.root, HttpAddress("0.0.0.0", 0), access=Access(is_open=True))
    server.start()
    other = Writer(f"http://{lan_address()}:{server.port}/")
    for method, path in (("POST", "/finds"), ("POST", "/reviews"), ("POST", "/scale"), ("POST", "/hints/dismissed")):
        assert other.send(method, path, HERE)[0] == 403
    assert other.get("/finds")["finds"] == []
    server.stop()
    assert not (flight.root / NOTES_NAME).exists()


def test_a_folder_that_is_away_is_said_and_comes_back_with_all(client: Writer, flight: MappedFlight) -> None:
    client.send("POST", "/finds", HERE)
    away = flight.root.with_name("away")
    flight.root.rename(away)
    status, said = client.send("POST", "/finds", HERE)
    assert status == 503
    assert (
        said
        == "The notes cannot be kept now, and nothing was changed: the flight's folder is gone, or another flight's.\n"
    )
    assert len(client.get("/finds")["finds"]) == 1
    away.rename(flight.root)
    (flight.root / NOTES_NAME).unlink()
    assert client.send("POST", "/finds", HERE)[0] == 201
    book = NotesBook(flight.root)
    assert len(Finds(book).all()) == 2
    book.close()


SERVE = """
import sys, threading
from pathlib import Path
from gcs_mosaic.web.address import HttpAddress
from gcs_mosaic.web.server import WebServer
print(WebServer(Path(sys.argv[1]), HttpAddress("127.0.0.1", 0)).start(), flush=True)
threading.Event().wait()
"""


@pytest.mark.long
def test_what_was_answered_with_success_outlives_a_kill(flight: MappedFlight) -> None:
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])}
    command = [sys.executable, "-c", SERVE, str(flight.root)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as process:
        assert process.stdout is not None
        client = Writer(process.stdout.readline())
        status, _ = client.send("POST", "/finds", HERE)
        process.send_signal(signal.SIGKILL)
    book = NotesBook(flight.root)
    assert (status, len(Finds(book).all()), book.revision) == (201, 1, 1)
    book.close()
