"""A mission, the debriefing and a find's message over HTTP."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import cv2
import numpy as np
import pytest

from gcs_mosaic.handover import message
from gcs_mosaic.notes.anchors.scales import Scales
from gcs_mosaic.notes.finds.finds import Finds, NewFind
from gcs_mosaic.notes.ground.binding import GroundFollower
from gcs_mosaic.notes.storage.book import NotesBook
from gcs_mosaic.views.flight_view import FlightView
from gcs_mosaic.web.address import HttpAddress
from gcs_mosaic.web.server import WebServer
from tests.handover.gapped import gapped_flight
from tests.sure import sure
from tests.web.test_app import Client


@pytest.fixture
def root(tmp_path: Path) -> Path:
    return gapped_flight(tmp_path / "flight")


@pytest.fixture
def client(root: Path) -> Iterator[Client]:
    server = WebServer(root, HttpAddress("127.0.0.1", 0))
    yield Client(server.start())
    server.stop()


@pytest.mark.parametrize(
    ("kind", "begins"), [("plan", "{"), ("waypoints", "QGC WPL 110\n"), ("kml", "<?xml"), ("gpx", "<?xml")]
)
def test_a_mission_is_given_as_a_file(client: Client, kind: str, begins: str) -> None:
    answer, body = client.ask(f"/api/v1/mission.{kind}?looks=2&height=80&island=0")
    assert answer.status == 200
    assert answer.headers["Content-Disposition"] == f'attachment; filename="gaps.{kind}"'
    assert body.decode().startswith(begins)


def test_why_there_is_no_mission_is_said(client: Client, tmp_path: Path) -> None:
    assert b"Island 7 has no anchor" in refused(client, "/api/v1/mission.plan?island=7", 409)
    assert b"looks" in refused(client, "/api/v1/mission.plan?looks=0", 400)
    assert b"height" in refused(client, "/api/v1/mission.plan?height=x", 400)
    server = WebServer(gapped_flight(tmp_path / "unsure", 0.7), HttpAddress("127.0.0.1", 0))
    assert b"--height METRES" in refused(Client(server.start()), "/api/v1/mission.plan", 409)
    server.stop()


def test_a_mission_asks_for_a_person_as_large_as_the_page_says(root: Path, client: Client) -> None:
    """By the distance that somebody has given, which says otherwise than the pins."""
    follower = GroundFollower(FlightView(root))
    ends = (follower.bound(0, 0.0, 0.0), follower.bound(0, 400.0, 0.0))
    with closing(NotesBook(root)) as book:
        Scales(book).create(ends, 100.0, "Ann")
    mission = "/api/v1/mission.plan?below=0.5"
    assert b"0 of" in refused(client, mission, 409)
    end = time.monotonic() + 30
    while (told := json.loads(client.ask("/api/v1/islands/0/detection")[1]))["measured"] < told["frames"]:
        assert time.monotonic() < end, told
        time.sleep(0.2)
    assert told["by"] == "distance"
    time.sleep(1.1)
    assert b"No picture can be measured" in refused(client, mission, 409)  # there are no originals


def refused(client: Client, path: str, status: int) -> bytes:
    answer, body = client.ask(path)
    assert answer.status == status
    return body


def test_the_debriefing_is_one_file(client: Client) -> None:
    answer, body = client.ask("/api/v1/debriefing.html")
    assert (answer.status, answer.headers["Content-Type"]) == (200, "text/html; charset=utf-8")
    assert "default-src 'none'" in answer.headers["Content-Security-Policy"]
    assert b"gapped: debriefing" in body


@pytest.fixture
def with_find(root: Path) -> Path:
    with closing(NotesBook(root)) as book:
        binding = GroundFollower(FlightView(root)).bound(0, 30.0, 20.0)
        Finds(book).create(NewFind(kind="tent", label="", note="", who="Kim", in_original=False, binding=binding))
    return root


def test_a_find_is_told_in_a_message(with_find: Path, client: Client) -> None:
    answer, body = client.ask("/api/v1/finds/1/message.txt")
    assert body.decode().startswith("Find 1 of flight - tent\n")
    known = {"If-None-Match": answer.headers["ETag"]}
    assert client.status("/api/v1/finds/1/message.txt", **known) == 304
    for path in ("/api/v1/finds/9/message.txt", "/api/v1/finds/9/crop.jpg"):
        assert client.status(path) == 404


def test_a_find_is_told_in_a_code_however_long_it_is(root: Path, client: Client) -> None:
    with closing(NotesBook(root)) as book:
        binding = GroundFollower(FlightView(root)).bound(0, 30.0, 20.0)
        for note in ("", "ö" * 900):
            Finds(book).create(NewFind(kind="tent", label="", note=note, who="Kim", in_original=False, binding=binding))
    sides = []
    for number in (1, 2):
        answer, body = client.ask(f"/api/v1/finds/{number}/code.svg")
        assert answer.headers["Content-Type"].startswith("image/svg+xml")
        sides.append(int(body.split(b'width="')[1].split(b'"')[0]))
    assert 100 < sides[0] < sides[1] < 600
    assert client.status("/api/v1/finds/9/code.svg") == 404


def test_what_a_find_shows_is_a_picture_or_is_not_there(
    with_find: Path, client: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert refused(client, "/api/v1/finds/1/crop.jpg", 404) == b"No original that shows it can be read.\n"
    monkeypatch.setattr(message, "original", lambda view, number: np.full((300, 600, 3), 90, np.uint8))
    _, body = client.ask("/api/v1/finds/1/crop.jpg")
    assert sure(cv2.imdecode(np.frombuffer(body, np.uint8), cv2.IMREAD_COLOR)).shape == (300, 400, 3)


def test_a_find_that_was_deleted_is_not_handed_over(with_find: Path, client: Client) -> None:
    with closing(NotesBook(with_find)) as book:
        Finds(book).delete(1, 1, "Kim")
    assert client.status("/api/v1/finds/1/message.txt") == 404
