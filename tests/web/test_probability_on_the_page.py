"""The figures under Probability are of who is asked for now, one layer has the legend, and a bar is of the island in view."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from gcs_mosaic.store.manifest import IslandEntry
from gcs_mosaic.web.address import HttpAddress
from gcs_mosaic.web.server import WebServer
from tests.web.browser import CHROMIUM, Page, open_browser
from tests.web.seen_flight import seen_flight

pytestmark = [pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine"), pytest.mark.long]

# What is asked waits until it is answered here.
HOLD = """void (() => {
  const real = window.fetch;
  window.held = [];
  window.fetch = (path, options) => !/[/](detection[?]|thermal$)/.test(path) ? real(path, options)
    : new Promise((answer) => window.held.push({ path, tell: (document, status = 200) =>
        answer(new Response(JSON.stringify(document), { status })) }));
  window.tellAll = (path, document, status) => {
    const found = window.held.filter((one) => one.path.includes(path));
    window.held = window.held.filter((one) => !one.path.includes(path));
    for (const one of found) one.tell(document, status);
    return found.length;
  };
})()"""
FIGURE = "document.getElementById('detection-told').textContent"
NOTES = "document.getElementById('detection-said').textContent"
COLOURS = ["#000000", "#ffffff"]
BAR = {"kind": "counts", "unit": "counts", "values": [1, 2, 3, 4, 5], "colours": COLOURS, "within": None}


def told(flown: float, covered: float = 1.0, leaves_unknown: float = 0.0) -> str:
    answer = {"map_revision": 1, "trouble": "", "flown": flown, "seen": flown, "part": None, "covered": covered}
    answer |= {
        "leaves_unknown": leaves_unknown,
        "frames": 19,
        "measured": 19,
        "person_px": 20.0,
        "by": "anchor",
        "colours": COLOURS,
    }
    return json.dumps(answer)


@pytest.fixture
def page(tmp_path: Path) -> Iterator[Page]:
    (tmp_path / "flight").mkdir()
    flight = seen_flight(tmp_path / "flight")
    flight.islands.append(IslandEntry(id=3, bounds=(0, 0, 512, 512), minzoom=14, maxzoom=16, frames=1))
    flight.write()
    server = WebServer(flight.root, HttpAddress("127.0.0.1", 0))
    with open_browser(tmp_path / "profile") as opened:
        opened.open(server.start())
        opened.wait_for("document.querySelectorAll('.leaflet-tile-loaded img').length > 0")
        opened.evaluate(HOLD)
        yield opened
    server.stop()


def dress(page: Page, clothes: str) -> None:
    field = "document.getElementById('detection-clothes')"
    page.evaluate(f"{field}.value = '{clothes}'; {field}.dispatchEvent(new Event('change'))")


def test_a_figure_is_of_who_is_asked_for_now(page: Page) -> None:
    page.evaluate("document.getElementById('open-detection').click()")
    page.wait_for("window.held.some((one) => one.path.includes('clothes=blue'))")
    dress(page, "red")
    page.evaluate(f"window.tellAll('clothes=blue', {told(0.9)})")
    page.wait_for("window.held.some((one) => one.path.includes('clothes=red'))")
    assert page.evaluate(FIGURE) == ""
    page.evaluate(f"window.tellAll('clothes=red', {told(0.4, 0.8)})")
    page.wait_for(f"{FIGURE}.startsWith('40 %')")
    assert "Of 20 % of that ground nothing is stated" in page.evaluate(NOTES)
    assert "leaves" not in page.evaluate(NOTES)
    dress(page, "white")
    assert page.evaluate(FIGURE) == ""
    page.evaluate(f"window.tellAll('clothes=white', {told(0.7, 1.0, 0.123)})")
    page.wait_for(f"{FIGURE}.startsWith('70 %')")
    assert "On 13 % of it no two looks tell whether leaves hide the ground" in page.evaluate(NOTES)
    dress(page, "olive")
    page.evaluate(f"window.tellAll('clothes=olive', {told(0.8, 1.0, 1.0)})")
    page.wait_for(f"{FIGURE}.startsWith('80 %')")
    assert "these figures are of open ground" in page.evaluate(NOTES)
    dress(page, "white")
    page.wait_for("window.tellAll('clothes=white', {}, 503) > 0")
    page.wait_for(f"{FIGURE} === ''")


def test_a_layer_that_is_chosen_takes_the_place_of_the_probability(page: Page) -> None:
    page.evaluate("document.getElementById('open-detection').click()")
    page.evaluate("document.getElementById('detection-show').click()")
    page.wait_for(f"window.tellAll('detection', {told(0.4)}) > 0")
    page.wait_for("!document.getElementById('legend').hidden")
    page.evaluate("document.getElementById('layer').value = 'looks'")
    page.evaluate("document.getElementById('layer').dispatchEvent(new Event('change'))")
    assert page.evaluate("document.getElementById('detection-show').getAttribute('aria-pressed')") == "false"
    page.wait_for(f"window.tellAll('detection', {told(0.4)}) > 0")
    legend = "document.getElementById('legend')"
    assert page.evaluate(f"{legend}.hidden") is False
    assert "Number of looks" in page.evaluate(f"{legend}.textContent")


def test_the_bar_of_another_island_goes_at_once(page: Page) -> None:
    thermal = "document.getElementById('thermal')"
    page.evaluate("document.getElementById('open-islands').click()")
    page.wait_for("document.querySelector('[data-island=\"3\"]')")
    page.evaluate("document.querySelector('[data-island=\"3\"]').click()")
    page.wait_for(
        f"window.tellAll('islands/3/thermal', {json.dumps({'map_revision': 999, 'scale': BAR})}) > 0 || !{thermal}.hidden"
    )
    page.wait_for(f"!{thermal}.hidden")
    page.evaluate("document.querySelector('[data-island=\"0\"]').click()")
    page.wait_for("window.held.some((one) => one.path.includes('islands/0/thermal'))")
    assert page.evaluate(f"{thermal}.hidden")
