"""A place on the map -> the frames that saw it: over HTTP, and in a real browser."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from gcs_mosaic.messages import content_hash
from gcs_mosaic.render.display import Display
from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.render.tile_grid import Tile
from gcs_mosaic.stitch.camera.dead_border import DeadBorder
from gcs_mosaic.stitch.camera.geometry import Camera, Pose, canvas_from_pixels
from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.records import FrameState
from gcs_mosaic.web.address import HttpAddress
from gcs_mosaic.web.server import WebServer
from tests.factories import frame
from tests.strangers import a_png
from tests.web.browser import CHROMIUM, open_browser
from tests.web.small_flight import MIDDLE, RED, SmallFlight
from tests.web.test_app import Client

SIZE = (400, 300)  # px, of the originals; they were stitched at half of it
CAMERA = Camera(200, 150, focal=1.3, k1=-0.05)
POSES = {
    "near.jpg": Pose(128.0, 128.0, log_gsd=-0.5),
    "far.jpg": Pose(128.0, 128.0, log_gsd=0.5),
    "rim.jpg": Pose(128.0 + 58.0, 128.0, log_gsd=-0.5),
    "elsewhere.jpg": Pose(5000.0, 128.0),
}


def encoded(name: str, suffix: str = ".jpg") -> bytes:
    noise = np.random.default_rng(len(name)).integers(0, 255, (*SIZE[::-1], 3), np.uint8)
    return bytes(cv2.imencode(suffix, noise)[1])


@pytest.fixture
def flight(tmp_path: Path) -> SmallFlight:
    flight = SmallFlight(tmp_path)
    (tmp_path / "frames").mkdir()
    with Ledger(tmp_path / LEDGER_NAME) as ledger:
        ledger.record_island(0)
        for name, pose in POSES.items():
            data = encoded(name)
            (tmp_path / "frames" / name).write_bytes(data)
            ledger.record_frame(frame(name, content_hash=content_hash(data)))
            ledger.record_original(name, f"frames/{name}")
            ledger.record_size(name, *SIZE)
            ledger.settle_frame(name, FrameState.PLACED)
            ledger.record_painted(RenderItem(name=name, order=0, island=0, pose=pose, camera=CAMERA, level=16))
    flight.paint(Tile(16, MIDDLE, MIDDLE), RED)
    flight.place("near.jpg", 128, 128)
    flight.write()
    return flight


@pytest.fixture
def url(flight: SmallFlight) -> Iterator[str]:
    server = WebServer(flight.root, HttpAddress("127.0.0.1", 0))
    yield server.start()
    server.stop()


def asked(client: Client, x: float, y: float) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = json.loads(client.ask(f"/api/v1/islands/0/sightings?x={x}&y={y}")[1])["sightings"]
    return found


def test_who_saw_a_place_comes_best_first_at_pixels_of_the_original(url: str) -> None:
    found = asked(Client(url), 130.0, 120.0)
    assert [one["name"] for one in found] == ["near.jpg", "rim.jpg", "far.jpg"]
    for one in found:
        reduced = (np.array([[one["x"], one["y"]]]) + 0.5) / 2 - 0.5
        assert np.abs(canvas_from_pixels(POSES[one["name"]], CAMERA, reduced) - [130.0, 120.0]).max() < 1e-3
    assert found[0]["canvas_per_px"] == pytest.approx(np.exp(-0.5) / 2, rel=0.05)
    assert [one["covered"] for one in found] == [False] * 3


@pytest.mark.long
def test_nobody_saw_a_place_that_lies_outside_and_on_dead_rows_nothing_is_seen(flight: SmallFlight, url: str) -> None:
    client = Client(url)
    assert asked(client, -4000.0, 0.0) == []
    with Ledger(flight.root / LEDGER_NAME) as ledger:
        dead = DeadBorder(left=120)
        one = RenderItem(name="near.jpg", order=0, island=0, pose=POSES["near.jpg"], camera=CAMERA, level=16, dead=dead)
        ledger.record_painted(one)
    flight.write()
    time.sleep(1.1)
    assert "near.jpg" not in [one["name"] for one in asked(client, 128.0, 128.0)]


def test_a_covered_frame_is_found_by_its_keyframe(flight: SmallFlight, url: str) -> None:
    with Ledger(flight.root / LEDGER_NAME) as ledger:
        ledger.record_frame(frame("covered.jpg"))
        ledger.record_size("covered.jpg", *SIZE)
        ledger.record_covered("covered.jpg", "far.jpg", ((1.0, 0.0, 10.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)))
    found = {one["name"]: one for one in asked(Client(url), 128.0, 128.0)}
    assert found["covered.jpg"]["x"] == pytest.approx(found["far.jpg"]["x"] - 20, abs=1e-6)
    assert found["covered.jpg"]["covered"]


@pytest.mark.parametrize("query", ["x=1", "x=a&y=1", "x=nan&y=1", "x=inf&y=0", "x=1e300&y=0", ""])
def test_a_place_that_is_none_is_refused(url: str, query: str) -> None:
    assert Client(url).status(f"/api/v1/islands/0/sightings?{query}") == 400


def test_originals_come_as_they_are_reduced_and_under_their_names(flight: SmallFlight, url: str) -> None:
    client = Client(url)
    assert client.ask("/api/v1/frames/1/original")[1] == encoded("near.jpg")
    assert client.ask("/api/v1/frames/1/picture")[1] == encoded("near.jpg")
    small = cv2.imdecode(
        np.frombuffer(client.ask("/api/v1/frames/1/picture?reduction=4")[1], np.uint8), cv2.IMREAD_COLOR
    )
    assert small is not None
    assert small.shape[:2] == (75, 100)
    assert client.status("/api/v1/frames/1/picture?reduction=3") == 400
    assert client.status("/api/v1/frames/99/picture") == 404


@pytest.mark.long
def test_a_bomb_in_the_place_of_an_original_costs_nothing(flight: SmallFlight, url: str) -> None:
    """A PNG of 19,900 x 19,900 pixels in a stranger's folder cost the page 2.4 GB, and 30 s without an answer."""
    bomb, client = a_png(12_000, 12_000), Client(url)
    (flight.root / "frames" / "near.jpg").write_bytes(bomb)
    start = time.monotonic()
    answer, said = client.ask("/api/v1/frames/1/picture?reduction=2")
    assert (answer.status, b"not what came" in said) == (404, True)
    for size in (SIZE, (12_000, 12_000)):  # the ledger may be the stranger's, too
        with Ledger(flight.root / LEDGER_NAME) as ledger:
            ledger.write("UPDATE frames SET content_hash = ? WHERE id = 1", content_hash(bomb))
            ledger.record_size("near.jpg", *size)
        answer, said = client.ask("/api/v1/frames/1/picture?reduction=2")
        assert answer.status == 404, said
    assert b"more than 4 times the largest frame" in said
    assert time.monotonic() - start < 10


def test_sixteen_bits_are_shown_as_on_the_map(flight: SmallFlight, url: str) -> None:
    counts = np.full((*SIZE[::-1],), 3000, np.uint16)
    data = bytes(cv2.imencode(".png", counts)[1])
    (flight.root / "frames" / "thermal.png").write_bytes(data)
    with Ledger(flight.root / LEDGER_NAME) as ledger:
        ledger.record_frame(frame("thermal.png", content_hash=content_hash(data)))
        ledger.record_original("thermal.png", "frames/thermal.png")
        ledger.record_size("thermal.png", *SIZE)
        display = Display((0, 0, 0), (2000,), (4000,))
        one = RenderItem(
            name="thermal.png",
            order=9,
            island=0,
            pose=Pose(0, 0),
            camera=CAMERA,
            level=16,
            display=display,
            gain=(1.0,),
        )
        ledger.record_painted(one)
    shown = cv2.imdecode(np.frombuffer(Client(url).ask("/api/v1/frames/5/picture")[1], np.uint8), cv2.IMREAD_COLOR)
    assert shown is not None
    assert abs(float(shown.mean()) - 127.5) < 2


@pytest.mark.parametrize("place", ["../secret.jpg", "/etc/hostname", "frames/gone.jpg"])
def test_nothing_outside_the_folder_is_an_original(flight: SmallFlight, url: str, place: str) -> None:
    """A ledger that somebody hands you may name any file."""
    (flight.root.parent / "secret.jpg").write_bytes(encoded("secret"))
    with Ledger(flight.root / LEDGER_NAME) as ledger:
        ledger.record_original("near.jpg", place)
    for way in ("original", "picture", "picture?reduction=2"):
        assert Client(url).status(f"/api/v1/frames/1/{way}") == 404


@pytest.mark.long
@pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")
def test_a_click_opens_the_originals_at_that_spot(tmp_path_factory: pytest.TempPathFactory, url: str) -> None:
    with open_browser(tmp_path_factory.mktemp("profile")) as page:
        page.resize(1280, 800)
        page.open(url)
        page.wait_for("document.querySelector('.leaflet-tile-loaded img') !== null")
        page.wait_for("document.querySelector('.leaflet-overlay-pane path') !== null")  # of near.jpg, about the place
        x, y = page.evaluate(
            "(({left, right, top, bottom}) => [(left + right) / 2, (top + bottom) / 2])"
            "(document.querySelector('.leaflet-overlay-pane path').getBoundingClientRect())"
        )
        for kind in ("mousePressed", "mouseReleased"):
            page.command("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)
        page.wait_for("document.getElementById('originals').dataset.sharp === 'near.jpg'")
        title = "document.getElementById('originals-title').innerText"
        assert page.evaluate(title).startswith("1 of 3: near.jpg")
        for key, name in (
            ("ArrowRight", "rim.jpg"),
            ("ArrowRight", "far.jpg"),
            ("b", "rim.jpg"),
            ("ArrowLeft", "near.jpg"),
        ):
            page.command("Input.dispatchKeyEvent", type="keyDown", key=key)
            page.wait_for(f"document.getElementById('originals').dataset.sharp === '{name}'")
        assert page.evaluate("document.getElementById('originals-download').download") == "near.jpg"
        page.command("Input.dispatchKeyEvent", type="keyDown", key="Escape")
        page.wait_for("document.getElementById('originals').hidden")
        assert page.complaints == []
