"""A lens over HTTP and on the page: what it shows, and one sentence where there is nothing to be shown."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.error import HTTPError
from urllib.parse import urlencode
from urllib.request import urlopen

import cv2
import numpy as np
import pytest

from gcs_mosaic.views.flight_view import FlightView
from tests.ended_flights import ended_flight
from tests.web.browser import CHROMIUM, Page
from tests.web.served import served

pytestmark = pytest.mark.long
TOLD, SAID = (f"document.getElementById('trees-{one}')" for one in ("told", "said"))


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory, world_cache: Path) -> Path:
    folder = tmp_path_factory.mktemp("lens")
    return ended_flight(folder / "flight", world_cache)


@pytest.fixture(scope="module")
def url(flown: Path) -> Iterator[str]:
    with served(flown) as address:
        yield address


def seen_by(flight: Path, least: int, most: int) -> tuple[int, float, float]:
    """An island and a place on it that so many frames see, of a grid over it, which is near the border of none."""
    table = FlightView(flight).table()
    island = int(table.islands[0])
    low, high = np.nanmin(table.boxes[:, :2], axis=0), np.nanmax(table.boxes[:, 2:], axis=0)
    for x in np.linspace(low[0], high[0], 40):
        for y in np.linspace(low[1], high[1], 40):
            inside = [cv2.pointPolygonTest(one.astype(np.float32), (x, y), True) for one in table.outlines]
            if min(map(abs, inside)) > 15 and least <= sum(one > 0 for one in inside) <= most:
                return island, float(x), float(y)
    raise AssertionError("no such place")


def ask(url: str, island: int, **asked: object) -> dict[str, Any]:
    with urlopen(f"{url.rstrip('/')}/api/v1/islands/{island}/integral?{urlencode(asked)}", timeout=60) as answer:
        return dict(json.load(answer))


def refusal(url: str, island: int, **asked: object) -> tuple[int, str]:
    with pytest.raises(HTTPError) as caught:
        ask(url, island, **asked)
    with caught.value as refused:
        return refused.code, refused.read().decode()


def test_a_click_alone_is_in_focus_at_the_ground(url: str, flown: Path) -> None:
    island, x, y = seen_by(flown, 3, 9)
    told = ask(url, island, x=x, y=y, cells=128, hints=2)
    assert told["looks"] >= 3
    assert told["ground"] == pytest.approx(0.0, abs=0.03)  # the ground of this flight is flat, and the map's
    assert told["height"] == told["ground"]
    picture = cv2.imdecode(np.frombuffer(base64.b64decode(told["picture"]), np.uint8), cv2.IMREAD_UNCHANGED)
    assert picture is not None
    assert picture.shape[:2] == (128, 128)
    blurred = ask(url, island, x=x, y=y, cells=128, height=0.06)
    assert blurred["ground"] == told["ground"]  # the lens is the same one
    other = cv2.imdecode(np.frombuffer(base64.b64decode(blurred["picture"]), np.uint8), cv2.IMREAD_UNCHANGED)
    assert other is not None
    assert cv2.Laplacian(other, cv2.CV_64F).std() < cv2.Laplacian(picture, cv2.CV_64F).std()
    narrow = ask(url, island, x=x, y=y, cells=128, height=0, aperture=0)
    assert narrow["looks"] < told["looks"]


def test_what_cannot_be_is_told_in_a_sentence(url: str, flown: Path) -> None:
    island, x, y = seen_by(flown, 1, 1)
    code, sentence = refusal(url, island, x=x, y=y)
    assert (code, "Only one frame sees this place" in sentence) == (409, True)
    island, x, y = seen_by(flown, 3, 9)
    assert "beyond what can be sought" in refusal(url, island, x=x, y=y, cells=64, height=-1.6)[1]
    assert "No frame of island" in refusal(url, island, x=1e6, y=1e6)[1]
    assert refusal(url, 77, x=x, y=y)[0] == 409
    assert refusal(url, island, x=x, y=y, form="sum")[0] == 400


MOVE = """void (() => {
  const focus = document.getElementById('trees-focus');
  focus.value = 4;
  focus.dispatchEvent(new Event('input'));
})()"""
HEAR = """import('/viewer/page.js').then(({ modules: { pointing: { Pointing } } }) => {
  const { take } = Pointing.prototype;
  Pointing.prototype.take = function (tool) {
    window.tool = tool;
    take.call(this, tool);
  };
})"""


def click(page: Page, x: float, y: float) -> None:
    """On a place of the map, after the button."""
    page.evaluate("document.getElementById('trees-open').click()")
    page.evaluate(f"void window.tool.place(0, {x}, {y})")


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")
def test_a_lens_opens_moves_and_says_why_not(url: str, flown: Path, page: Page) -> None:
    _, x, y = seen_by(flown, 3, 9)
    _, lonely_x, lonely_y = seen_by(flown, 1, 1)
    page.open(url)
    page.wait_for("document.documentElement.dataset.begun && document.querySelector('#map .leaflet-tile-pane img')", 30)
    page.evaluate("document.getElementById('open-trees').click()")
    page.evaluate(HEAR)
    click(page, x, y)
    page.wait_for(f"{TOLD}.dataset.looks >= 3", 60)
    assert page.evaluate("document.querySelectorAll('img.lens').length") == 1
    page.evaluate(MOVE)
    page.wait_for(f"{TOLD}.textContent.includes(' 4.0 %')", 30)
    click(page, lonely_x, lonely_y)
    page.wait_for(f"{SAID}.textContent.includes('Only one frame')", 30)
    assert page.evaluate("document.querySelectorAll('img.lens').length") == 0
    assert page.complaints == []
    page.open("about:blank")


PIXEL = base64.b64encode(cv2.imencode(".jpg", np.zeros((8, 8), np.uint8))[1].tobytes()).decode()
TELL = """import('/viewer/page.js').then(({ modules: { trees: { Trees } } }) => {
  const { lay } = Trees.prototype;
  Trees.prototype.lay = function (...place) {
    this.measure = { scales: new Map([[0, { metres_per_unit: 0.5 }]]) };
    lay.apply(this, place);
  };
  const real = window.fetch;
  window.fetch = async (address, ...rest) =>
    String(address).includes('/integral?') ? new Response(JSON.stringify(window.lens)) : real(address, ...rest);
})"""
TEXT = f"{TOLD}.textContent"


def lens_told(**other: object) -> str:
    told: dict[str, object] = {"map_revision": 1 << 40, "height": -0.1, "ground": None, "lowest": -0.4, "highest": 0.5}
    told |= {"flying_height": 200.0, "known_to": 1.25, "looks": 30, "spread_deg": 40.0, "width": 0.5, "lost": 0}
    told |= {"left_out": 0, "left": 0.0, "top": 0.0, "side": 50.0, "picture": PIXEL, "hints": []}
    return json.dumps(told | other)


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")
def test_a_lens_tells_what_is_not_known_of_it(url: str, page: Page) -> None:
    """Metres only with how far the focal length is known, and no ground where none was found."""
    ground = "document.getElementById('trees-ground').textContent"
    page.open(url)
    page.wait_for("document.documentElement.dataset.begun && document.querySelector('#map .leaflet-tile-pane img')", 30)
    page.evaluate("document.getElementById('open-trees').click()")
    page.evaluate(HEAR)
    page.evaluate(TELL)
    page.evaluate(f"void (window.lens = {lens_told()})")
    click(page, 10, 10)
    page.wait_for(f"{TEXT}.includes('about -10.0 m (-12.5 to -8.0 m)')", 30)
    assert page.evaluate(ground) == "To the map's ground"
    assert "more looks" not in page.evaluate(TEXT)
    page.evaluate(f"void (window.lens = {lens_told(known_to=None, ground=-0.05, left_out=7, map_revision=0)})")
    click(page, 10, 10)
    page.wait_for(f"{TEXT}.includes('7 more looks')", 30)
    assert page.evaluate(ground) == "To the ground"
    assert " m (" not in page.evaluate(TEXT)
    assert "the pictures do not tell the angle of view" in page.evaluate(TEXT)
    assert "The map has changed since the lens was opened" in page.evaluate(TEXT)
    assert page.complaints == []
    page.open("about:blank")
