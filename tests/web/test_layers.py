"""Layers and gaps over HTTP, and in a real browser."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from gcs_mosaic.web.address import HttpAddress
from gcs_mosaic.web.server import WebServer
from tests.sure import sure
from tests.web.browser import CHROMIUM, open_browser
from tests.web.seen_flight import HOLE, seen_flight
from tests.web.small_flight import MIDDLE, SmallFlight
from tests.web.test_app import Client


@pytest.fixture
def flight(tmp_path: Path) -> SmallFlight:
    return seen_flight(tmp_path)


@pytest.fixture
def url(flight: SmallFlight) -> Iterator[str]:
    server = WebServer(flight.root, HttpAddress("127.0.0.1", 0))
    yield server.start()
    server.stop()


def test_each_layer_has_a_legend_and_tiles(url: str) -> None:
    client = Client(url)
    layers = json.loads(client.ask("/api/v1/layers")[1])["layers"]
    assert [layer["name"] for layer in layers] == ["looks", "resolution", "sharpness", "angle", "confidence", "age"]
    for layer in layers:
        path = f"/api/v1/layers/{layer['name']}/0/16/{MIDDLE}/{MIDDLE}.png"
        answer, data = client.ask(path)
        tile = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
        assert tile is not None
        assert tile.shape == (256, 256, 4)
        assert (tile[..., 3] > 0).all()
        assert client.status(path, **{"If-None-Match": answer.headers["ETag"]}) == 304


def test_more_looks_have_another_colour_and_coarse_tiles_tell_the_same(url: str) -> None:
    """Frames overlap by forty pixels: two looks there, one between."""
    tiles = {}
    for level in (16, 14):
        place = MIDDLE >> (16 - level)
        data = Client(url).ask(f"/api/v1/layers/looks/0/{level}/{place}/{place}.png")[1]
        tiles[level] = sure(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED))
    one, two = tiles[16][10, 10], tiles[16][10, 100]  # canvas (10, 10) and (100, 10)
    assert one.tolist() != two.tolist()
    assert tiles[14][2, 2].tolist() == one.tolist()
    assert tiles[14][2, 25].tolist() == two.tolist()


@pytest.mark.parametrize(
    "path", ["looks/0/99/0/0", "looks/0/3/9/0", "lies/0/16/0/0", "looks/x/16/0/0", "looks/0/16/-1/0", "looks/0/16/0"]
)
def test_a_tile_that_cannot_be_is_not_there(url: str, path: str) -> None:
    assert Client(url).status(f"/api/v1/layers/{path}.png") == 404


def test_where_nothing_was_seen_a_tile_is_transparent(url: str) -> None:
    for island in (0, 77):
        data = Client(url).ask(f"/api/v1/layers/looks/{island}/16/5/5.png")[1]
        tile = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
        assert tile is not None
        assert not tile[..., 3].any()


def test_the_frame_that_is_missing_is_a_gap(url: str) -> None:
    (gap,) = json.loads(Client(url).ask("/api/v1/islands/0/gaps")[1])["gaps"]
    assert gap["inside"] == pytest.approx(
        [HOLE[0] * 200, HOLE[1] * 150], abs=40
    )  # the middle of a flat hole is not one point
    assert gap["area"] == pytest.approx(160 * 120, rel=0.1)  # less what its neighbours see of it
    assert json.loads(Client(url).ask("/api/v1/islands/77/gaps")[1]) == {"map_revision": 1, "gaps": []}


@pytest.mark.long
@pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")
def test_gaps_are_on_the_page_without_a_click_and_layers_with_one(
    tmp_path_factory: pytest.TempPathFactory, url: str
) -> None:
    with open_browser(tmp_path_factory.mktemp("profile")) as page:
        page.resize(1280, 800)
        page.open(url)
        page.wait_for("document.getElementById('gaps').innerText === 'Gaps: 1'")
        dashed = "document.querySelectorAll('#map path[stroke-dasharray]').length"
        assert page.evaluate(dashed) == 1
        page.evaluate(
            "(() => { const select = document.getElementById('layer'); select.value = 'looks';"
            " select.dispatchEvent(new Event('change')) })()"
        )
        page.wait_for(
            "[...document.querySelectorAll('.leaflet-tile-loaded img')].some((i) => i.src.includes('/layers/looks/'))"
        )
        assert page.evaluate("document.getElementById('legend').innerText").startswith("Number of looks")
        page.evaluate("document.getElementById('gaps').click()")
        page.wait_for(f"{dashed} === 0")
        assert page.complaints == []
