"""Large originals come in pieces; how long one waits until the place that was asked for is sharp."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from gcs_mosaic.messages import content_hash
from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.render.tile_grid import Tile
from gcs_mosaic.stitch.camera.geometry import Camera, Pose
from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.records import FrameState
from gcs_mosaic.web.address import HttpAddress
from gcs_mosaic.web.server import WebServer
from tests.factories import frame
from tests.sure import sure
from tests.web.browser import CHROMIUM, open_browser
from tests.web.small_flight import MIDDLE, RED, SmallFlight
from tests.web.test_app import Client

NAME = "large.jpg"


def flown(folder: Path, width: int, height: int) -> SmallFlight:
    """A flight of one frame of that size, in which every pixel matters."""
    flight = SmallFlight(folder)
    (folder / "frames").mkdir()
    coarse = np.random.default_rng(1).integers(0, 255, (height // 4, width // 4), np.uint8)
    fine = cv2.resize(cv2.cvtColor(coarse, cv2.COLOR_GRAY2BGR), (width, height), interpolation=cv2.INTER_CUBIC)
    data = cv2.imencode(".jpg", fine)[1].tobytes()
    (folder / "frames" / NAME).write_bytes(data)
    with Ledger(folder / LEDGER_NAME) as ledger:
        ledger.record_island(0)
        ledger.record_frame(frame(NAME, content_hash=content_hash(data)))
        ledger.record_original(NAME, f"frames/{NAME}")
        ledger.record_size(NAME, width, height)
        ledger.settle_frame(NAME, FrameState.PLACED)
        camera = Camera(width, height, focal=1.0)
        pose = Pose(128.0, 128.0)
        ledger.record_painted(RenderItem(name=NAME, order=0, island=0, pose=pose, camera=camera, level=16))
    flight.paint(Tile(16, MIDDLE, MIDDLE), RED)
    flight.place(NAME, 128, 128)
    flight.write()
    return flight


def test_pieces_are_those_of_the_picture_and_end_where_it_does(tmp_path: Path) -> None:
    flight = flown(tmp_path, 1200, 700)
    server = WebServer(flight.root, HttpAddress("127.0.0.1", 0))
    client = Client(server.start())
    whole = sure(cv2.imread(str(tmp_path / "frames" / NAME)))
    body = client.ask("/api/v1/frames/1/pieces/2/1.jpg")[1]
    piece = sure(cv2.imdecode(np.frombuffer(body, np.uint8), cv2.IMREAD_COLOR))
    assert piece.shape == (700 - 512, 1200 - 1024, 3)
    assert np.abs(piece.astype(int) - whole[512:, 1024:]).mean() < 4
    for nowhere in ("3/0", "0/2", "9999/9999"):
        assert client.status(f"/api/v1/frames/1/pieces/{nowhere}.jpg") == 404
    server.stop()


@pytest.mark.long
@pytest.mark.thorough
@pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")
@pytest.mark.parametrize(("width", "height", "most_ms"), [(4000, 3000, 1000), (8000, 6000, 2000)])
def test_the_place_is_sharp_soon(tmp_path: Path, width: int, height: int, most_ms: float) -> None:
    server = WebServer(flown(tmp_path, width, height).root, HttpAddress("127.0.0.1", 0))
    with open_browser(tmp_path / "profile") as page:
        page.resize(1280, 800)
        page.open(server.start())
        page.wait_for("document.querySelector('.leaflet-tile-loaded img') !== null")
        page.evaluate(
            "addEventListener('click', () => (window.asked = performance.now()), true);"
            "new MutationObserver(() => (window.sharp = document.getElementById('originals').dataset.sharp && performance.now()))"
            ".observe(document.getElementById('originals'), {attributes: true, attributeFilter: ['data-sharp']})"
        )
        for kind in ("mousePressed", "mouseReleased"):
            page.command("Input.dispatchMouseEvent", type=kind, x=640, y=440, button="left", clickCount=1)
        page.wait_for("window.sharp > 0")
        waited_ms = page.evaluate("window.sharp - window.asked")
        print(f"{width} x {height}: sharp after {waited_ms:.0f} ms")
        assert waited_ms < most_ms
        if width * height > 16e6:
            page.wait_for("document.querySelectorAll('#original .leaflet-tile-loaded').length >= 4")
        assert page.complaints == []
    server.stop()
