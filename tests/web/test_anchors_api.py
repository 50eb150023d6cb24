"""Anchors over HTTP: pins, positions, coordinates of places; finds and scale with them."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gcs_mosaic.geo.ellipsoid import LocalPlane
from gcs_mosaic.messages import Position
from gcs_mosaic.notes.storage.book import NotesBook
from gcs_mosaic.notes.storage.schema import NOTES
from gcs_mosaic.stitch.camera.geometry import Pose
from gcs_mosaic.store.folder import LEDGER_NAME, NOTES_NAME
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.records import EventState
from gcs_mosaic.views import flight_view
from gcs_mosaic.web.address import HttpAddress
from gcs_mosaic.web.feed import Feed
from gcs_mosaic.web.server import WebServer
from tests.factories import frame, trigger_event
from tests.notes.mapped import MappedFlight
from tests.web.test_notes_api import HERE, Writer

PLANE = LocalPlane(7.0, 44.5)
GSD_M = 0.2
SPOTS = ((0.0, -100.0), (400.0, -100.0), (400.0, 100.0), (0.0, 100.0))


@pytest.fixture(autouse=True)
def _always_fresh(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(flight_view, "LEAST_REST_S", 0.0)
    monkeypatch.setattr(flight_view, "REST", 0.0)


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


def place(x: float, y: float) -> tuple[float, float]:
    """Longitude and latitude of a canvas place of a map that is north-up."""
    longitude, latitude = PLANE.places(np.array([x, -y]) * GSD_M)
    return float(longitude), float(latitude)


def pin(x: float, y: float, /, **change: Any) -> dict[str, Any]:
    longitude, latitude = place(x, y)
    return {
        "island": 0,
        "x": x,
        "y": y,
        "coordinate": f"{latitude:.9f}, {longitude:.9f}",
        "sigma_m": 0.5,
        "who": "Kim",
        **change,
    }


def set_pins(client: Writer, count: int) -> None:
    for at, spot in enumerate(SPOTS[:count]):
        status, told = client.send("POST", "/pins", pin(*spot, label=f"corner {at}"))
        assert status == 201, told


def test_pins_lay_the_map_and_all_that_is_on_it(client: Writer) -> None:
    client.send("POST", "/finds", HERE)
    assert client.get("/finds")["finds"][0]["geo"] is None
    assert client.get("/coordinates?island=0&x=20&y=30")["place"] is None
    set_pins(client, 2)
    assert [one["checked"] for one in client.get("/anchors")["islands"]] == [False]
    client.send("POST", "/pins", pin(*SPOTS[2]))
    (laid,) = client.get("/anchors")["islands"]
    assert (laid["by"], laid["checked"], laid["misfit"], laid["pins"]) == ("pins", True, None, [1, 2, 3])
    assert laid["anchor"]["metres_per_unit"] == pytest.approx(GSD_M, rel=1e-3)
    assert laid["anchor"]["north_deg"] == pytest.approx(0.0, abs=0.05)
    told = client.get("/coordinates?island=0&x=20&y=30")["place"]
    assert (told["longitude"], told["latitude"]) == pytest.approx(place(20, 30), abs=1e-7)
    assert 0.5 < told["error_m"] < 2.0
    assert told["mgrs"].startswith("32TLQ")
    geo = client.get("/finds")["finds"][0]["geo"]
    assert (geo["longitude"], geo["latitude"]) == pytest.approx(place(20, 30), abs=1e-7)
    assert '"coordinates": [\n' in client.send("GET", "/finds.geojson")[1]
    assert client.get("/scale")["islands"][0]["source"] == "anchor"


def test_the_way_back_from_a_coordinate(client: Writer) -> None:
    set_pins(client, 3)
    longitude, latitude = place(50.0, 60.0)
    (found,) = client.get(f"/canvas?at={latitude:.9f},{longitude:.9f}")["places"]
    assert (found["island"], found["x"], found["y"]) == pytest.approx((0, 50.0, 60.0), abs=0.05)
    assert client.get("/canvas?at=-10.0,100.0")["places"] == []


def test_a_pin_can_be_taken_away_and_brought_back(client: Writer) -> None:
    set_pins(client, 4)
    client.send("POST", "/pins", pin(150.0, 50.0, coordinate="44.520000, 7.000000", label="wrong"))
    assert client.get("/anchors")["islands"][0]["misfit"] == "wrong"
    assert client.get("/anchors")["islands"][0]["misfits"] == ["wrong"]
    assert client.send("DELETE", "/pins/5")[1]["deleted"] is True
    assert client.get("/anchors")["islands"][0]["checked"] is True
    assert client.send("POST", "/pins/5/restore")[1]["deleted"] is False
    assert client.get("/anchors")["islands"][0]["misfit"] == "wrong"
    assert client.send("DELETE", "/pins/9")[0] == 404


@pytest.mark.parametrize(
    ("coordinate", "sigma_m"), [("32TLQ 501 304", 28.87), ("44.51, 7.12", 321.35), ("44.5123456, 7.12", 0.5)]
)
def test_a_coordinate_is_no_more_exact_than_its_digits(client: Writer, coordinate: str, sigma_m: float) -> None:
    """Of two numbers those of the longer one: programs leave out zeros at an end."""
    status, told = client.send("POST", "/pins", pin(*SPOTS[0], coordinate=coordinate))
    assert (status, told["sigma_m"]) == (201, pytest.approx(sigma_m, abs=0.01))
    assert client.send("POST", "/pins", pin(*SPOTS[0], coordinate=coordinate, sigma_m=500))[1]["sigma_m"] == 500


def test_pins_follow_the_ground_when_the_map_moves(client: Writer, flight: MappedFlight) -> None:
    set_pins(client, 3)
    for name, x in (("a.jpg", 1000.0), ("b.jpg", 1300.0)):
        flight.paint(name, Pose(x, 0.0, yaw=0.2 if name == "a.jpg" else 0.0, pitch=0.05 if name == "a.jpg" else 0.0))
    told = client.get("/coordinates?island=0&x=1020&y=30")["place"]
    assert (told["longitude"], told["latitude"]) == pytest.approx(place(20, 30), abs=1e-7)


@pytest.mark.long
def test_an_island_without_pins_has_no_anchor(client: Writer) -> None:
    set_pins(client, 3)
    assert client.get("/coordinates?island=1&x=0&y=0")["place"] is None


def test_positions_lay_the_map_only_when_somebody_asks(client: Writer, flight: MappedFlight) -> None:
    fly(flight, 24)
    assert client.get("/anchors")["islands"] == []
    assert client.send("PUT", "/anchors/positions", {"asked": True, "who": "Kim"})[0] == 200
    found = client.get("/anchors")
    laid = next(one for one in found["islands"] if one["island"] == 0)
    assert found["by_positions"] is True
    assert (laid["by"], laid["shots"], laid["outliers"]) == ("positions", 24, 0)
    told = client.get("/coordinates?island=0&x=1000&y=500")["place"]
    assert (told["longitude"], told["latitude"]) == pytest.approx(place(1000, 500), abs=1e-6)
    assert told["error_m"] > 4.0
    client.send("PUT", "/anchors/positions", {"asked": False, "who": "Kim"})
    assert client.get("/anchors")["islands"] == []


def test_each_island_is_laid_by_the_positions_of_the_aircraft_that_flew_it(
    client: Writer, flight: MappedFlight
) -> None:
    fly(flight, 24)
    fly(flight, 12, vehicle=2, island=1)
    client.send("PUT", "/anchors/positions", {"asked": True, "who": "Kim"})
    laid = {one["island"]: one for one in client.get("/anchors")["islands"]}
    assert (laid[0]["shots"], laid[1]["shots"]) == (24, 12)


def test_too_few_positions_say_so_and_pins_are_worth_more(client: Writer, flight: MappedFlight) -> None:
    fly(flight, 5)
    client.send("PUT", "/anchors/positions", {"asked": True, "who": "Kim"})
    (laid,) = client.get("/anchors")["islands"]
    assert "8 are needed" in laid["refused"]
    assert laid["anchor"] is None
    set_pins(client, 3)
    assert client.get("/anchors")["islands"][0]["by"] == "pins"


def fly(flight: MappedFlight, count: int, vehicle: int = 1, island: int = 0) -> None:
    """Lines of six frames, each with a position in its trigger, told twice."""
    for at in range(count):
        name, x, y = f"{vehicle}/{at}.jpg", 300.0 * (at % 6), 2000.0 * (at // 6)
        with Ledger(flight.root / LEDGER_NAME) as ledger:
            ledger.record_frame(frame(name))
        flight.paint(name, Pose(x, y, pitch=0.1), island)
        longitude, latitude = place(x, y)
        position = Position(latitude_deg=latitude, longitude_deg=longitude, altitude_m=None)
        event = trigger_event(sequence=at, received=100.0 + 6 * at, position=position, vehicle=vehicle)
        with Ledger(flight.root / LEDGER_NAME) as ledger:
            number = ledger.record_event(event)
            ledger.settle_event(number, EventState.MATCHED, frame=name)
            ledger.record_event(
                trigger_event(sequence=at, received=101.0 + 6 * at, vehicle=vehicle), duplicate_of=number
            )


@pytest.mark.parametrize(
    "change",
    [
        {"coordinate": "somewhere"}, {"coordinate": 7}, {"coordinate": None}, {"coordinate": "44.5, 197"}, {"sigma_m": 0},
        {"sigma_m": "3"}, {"who": ""}, {"x": None}, {"island": -1}, {"frame": 77, "pixel": [1, 1]}, {"label": "x" * 200},
        {"coordinate": None, "longitude": 7, "latitude": 91},
    ],
)  # fmt: skip
def test_what_is_unfit_is_refused_in_a_sentence(client: Writer, change: dict[str, Any]) -> None:
    status, said = client.send("POST", "/pins", pin(0.0, 0.0, **change))
    assert (status, said[-2:]) == (400, ".\n")
    assert client.get("/anchors")["pins"] == []


@pytest.mark.parametrize(
    "path", ["/canvas?at=x", "/canvas", "/coordinates?island=0&x=1", "/coordinates?island=x&x=1&y=1"]
)
def test_questions_that_are_none(client: Writer, path: str) -> None:
    assert client.send("GET", path)[0] == 400


def test_notes_of_before_pins_are_taken_over(flight: MappedFlight) -> None:
    with_pins = NOTES.tables
    before = with_pins[: with_pins.index("\nCREATE TABLE pins")]
    before = "".join(line for line in before.splitlines(keepends=True) if "newest INTEGER" not in line)
    path = flight.root / NOTES_NAME
    old = sqlite3.connect(path)
    old.executescript(f"{before} PRAGMA application_id = {NOTES.application}; PRAGMA user_version = 1;")
    old.execute("INSERT INTO reviewers (name) VALUES ('Kim')")
    old.commit()
    old.close()
    book = NotesBook(flight.root)
    with book.change() as file:
        file.write("INSERT INTO anchoring VALUES (1, 1, 'Kim', 1.0)")
    assert [row["name"] for row in book.rows("SELECT name FROM reviewers")] == ["Kim"]
    book.close()
