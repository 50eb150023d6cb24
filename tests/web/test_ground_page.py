"""The map in focus at the ground, over HTTP and on the page: made while somebody looks, and only there."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.error import HTTPError
from urllib.parse import urlencode
from urllib.request import urlopen

import numpy as np
import pytest

from gcs_mosaic.render.tile_grid import TILE_SIZE, level_from_canvas
from gcs_mosaic.views.flight_view import FlightView
from gcs_mosaic.web.address import HttpAddress
from gcs_mosaic.web.server import WebServer
from tests.ended_flights import ended_flight
from tests.web.browser import CHROMIUM, open_browser

pytestmark = pytest.mark.long
LEVEL = 16
IN_TIME_S = 120.0
TOLD = "document.getElementById('ground-told')"
SHOWN = "[...document.querySelectorAll('.ground-tile img')].filter((one) => one.naturalWidth === 256).length"


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory, world_cache: Path) -> Path:
    folder = tmp_path_factory.mktemp("trees")
    return ended_flight(folder / "flight", world_cache)


@pytest.fixture(scope="module")
def url(flown: Path) -> Iterator[str]:
    server = WebServer(flown, HttpAddress("127.0.0.1", 0))
    yield server.start().rstrip("/")
    server.stop()


def view_of(flight: Path) -> dict[str, object]:
    """The tiles that the flight touches."""
    boxes = FlightView(flight).table().boxes
    low, high = np.nanmin(boxes[:, :2], axis=0), np.nanmax(boxes[:, 2:], axis=0)
    (left, top), (right, bottom) = (
        (level_from_canvas(LEVEL, one) // TILE_SIZE).astype(int).tolist() for one in (low, high)
    )
    return {"z": LEVEL, "left": left, "top": top, "right": right, "bottom": bottom}


def ask(url: str, **asked: object) -> dict[str, Any]:
    with urlopen(f"{url}/api/v1/islands/0/ground?{urlencode(asked)}", timeout=60) as answer:
        return dict(json.load(answer))


def refusal(url: str, **asked: object) -> tuple[int, str]:
    with pytest.raises(HTTPError) as caught:
        ask(url, **asked)
    with caught.value as refused:
        return refused.code, refused.read().decode()


def tile(url: str, x: int, y: int, **asked: object) -> tuple[str, bytes]:
    with urlopen(f"{url}/api/v1/ground/0/{LEVEL}/{x}/{y}.webp?{urlencode(asked)}", timeout=60) as answer:
        return answer.headers["Content-Type"], answer.read()


def test_what_is_asked_for_is_made_and_nothing_else(url: str, flown: Path) -> None:
    asked = view_of(flown) | {"height": 0}
    x, y = (int(str(asked[name])) for name in ("left", "top"))
    nothing = [tile(url, x + 1, y + 1, height=0) for _ in range(2)]
    assert {kind for kind, _ in nothing} == {"image/png"}  # transparent: nobody has asked what there is
    end = time.monotonic() + IN_TIME_S
    while (answer := ask(url, **asked))["waiting"]:
        assert time.monotonic() < end
        time.sleep(0.1)
    assert {one["x"] % answer["span"] for one in answer["parts"]} == {0}
    tiles = [
        tile(url, column, row, height=0)[0]
        for column in range(x, int(str(asked["right"])) + 1)
        for row in range(y, int(str(asked["bottom"])) + 1)
    ]
    assert "image/webp" in tiles
    assert answer["trouble"] == ""
    assert ask(url, **asked | {"height": 0.3})["waiting"]  # in another focus all is to be made
    assert ask(url, **asked)["parts"] == answer["parts"]  # and this is as it was


def test_what_cannot_be_is_refused(url: str, flown: Path) -> None:
    asked = view_of(flown)
    assert "64 parts at most" in refusal(url, z=20, left=0, top=0, right=1 << 19, bottom=1 << 19)[1]
    for wrong in ({"height": 0.9}, {"height": "nan"}, {"z": 25}, {"left": -1}, {"right": "x"}, {"right": 1 << 30}):
        assert refusal(url, **asked | wrong)[0] == 400
    for path in (f"0/{LEVEL}/99999/1.webp", f"0/{LEVEL}/1/1.webp?height=7", "0/30/1/1.webp"):
        with pytest.raises(HTTPError) as caught:
            urlopen(f"{url}/api/v1/ground/{path}", timeout=60)
        with caught.value as refused:
            assert refused.code in (400, 404)
    assert ask(url, **asked | {"left": 9, "right": 3})["parts"] == []


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")
def test_the_page_shows_the_ground_and_the_map_again(url: str, tmp_path: Path) -> None:
    with open_browser(tmp_path / "profile") as page:
        page.open(url)
        page.wait_for(
            "document.documentElement.dataset.begun && document.querySelector('#map .leaflet-tile-loaded img')", 30
        )
        page.evaluate("document.getElementById('open-trees').click()")
        page.evaluate("document.getElementById('ground-show').click()")
        page.wait_for(f"{TOLD}.dataset.waiting === '0' && {SHOWN} > 0", IN_TIME_S)
        dimmed = "getComputedStyle(document.querySelector('.leaflet-tile:not(.ground-tile) img')).opacity"
        assert page.evaluate(dimmed) == "0.4"
        assert "All of this view is laid together" in page.evaluate(f"{TOLD}.textContent")
        shown = page.evaluate("[...document.querySelectorAll('.ground-tile img')].map((one) => one.src).join()")
        assert "height" not in shown
        page.evaluate(
            "void (document.getElementById('ground-focus').value = 10,"
            " document.getElementById('ground-focus').dispatchEvent(new Event('change')))"
        )
        page.wait_for(
            f"{TOLD}.dataset.waiting === '0' && {TOLD}.textContent.startsWith('All') && {SHOWN} > 0", IN_TIME_S
        )
        assert "height=0.1" in page.evaluate("document.querySelector('.ground-tile img').src")
        page.evaluate("document.getElementById('ground-show').click()")
        assert page.evaluate("document.querySelectorAll('.ground-tile').length") == 0
        assert page.evaluate(dimmed) == "1"
        assert page.complaints == []
        page.open("about:blank")
