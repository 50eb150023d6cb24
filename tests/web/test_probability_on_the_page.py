"""The figures under Probability are of who is asked for now, one layer has the legend, and a bar is of the island in view."""

from __future__ import annotations

import json

import pytest

from gcs_mosaic.store.manifest import IslandEntry
from tests.web.answers import faults_at
from tests.web.browser import CHROMIUM, Page
from tests.web.small_flight import SmallFlight

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
    """As the API describes its answer."""
    answer = {"map_revision": 1, "trouble": "", "flown": flown, "seen": flown, "part": None, "covered": covered}
    answer |= {
        "leaves_unknown": leaves_unknown,
        "frames": 19,
        "measured": 19,
        "person_px": 20.0,
        "by": "anchor",
        "colours": COLOURS,
    }
    return described("detection", answer)


def described(what: str, answer: object, status: int = 200) -> str:
    """The JSON of an answer of an island, which is as the API describes it."""
    text = json.dumps(answer)
    kind = "application/json" if status == 200 else "text/plain"
    assert faults_at(f"/api/v1/islands/0/{what}", status, kind, text.encode()) == []
    return text


@pytest.fixture
def flight(flight: SmallFlight) -> SmallFlight:
    """With another island."""
    flight.islands.append(IslandEntry(id=3, bounds=(0, 0, 512, 512), minzoom=14, maxzoom=16, frames=1))
    flight.write()
    return flight


@pytest.fixture
def held(page: Page, url: str) -> Page:
    """The page, whose questions for figures and bars wait."""
    page.open(url)
    page.wait_for("document.querySelectorAll('.leaflet-tile-loaded img').length > 0")
    page.evaluate(HOLD)
    return page


def dress(page: Page, clothes: str) -> None:
    field = "document.getElementById('detection-clothes')"
    page.evaluate(f"{field}.value = '{clothes}'; {field}.dispatchEvent(new Event('change'))")


def test_a_figure_is_of_who_is_asked_for_now(held: Page) -> None:
    held.evaluate("document.getElementById('open-detection').click()")
    held.wait_for("window.held.some((one) => one.path.includes('clothes=blue'))")
    dress(held, "red")
    held.evaluate(f"window.tellAll('clothes=blue', {told(0.9)})")
    held.wait_for("window.held.some((one) => one.path.includes('clothes=red'))")
    assert held.evaluate(FIGURE) == ""
    held.evaluate(f"window.tellAll('clothes=red', {told(0.4, 0.8)})")
    held.wait_for(f"{FIGURE}.startsWith('40 %')")
    assert "Of 20 % of that ground nothing is stated" in held.evaluate(NOTES)
    assert "leaves" not in held.evaluate(NOTES)
    dress(held, "white")
    assert held.evaluate(FIGURE) == ""
    held.evaluate(f"window.tellAll('clothes=white', {told(0.7, 1.0, 0.123)})")
    held.wait_for(f"{FIGURE}.startsWith('70 %')")
    assert "On 13 % of it no two looks tell whether leaves hide the ground" in held.evaluate(NOTES)
    dress(held, "olive")
    held.evaluate(f"window.tellAll('clothes=olive', {told(0.8, 1.0, 1.0)})")
    held.wait_for(f"{FIGURE}.startsWith('80 %')")
    assert "these figures are of open ground" in held.evaluate(NOTES)
    dress(held, "white")
    held.wait_for(f"window.tellAll('clothes=white', {described('detection', 'Busy.', 503)}, 503) > 0")
    held.wait_for(f"{FIGURE} === ''")


def test_a_layer_that_is_chosen_takes_the_place_of_the_probability(held: Page) -> None:
    held.evaluate("document.getElementById('open-detection').click()")
    held.evaluate("document.getElementById('detection-show').click()")
    held.wait_for(f"window.tellAll('detection', {told(0.4)}) > 0")
    held.wait_for("!document.getElementById('legend').hidden")
    held.evaluate("document.getElementById('layer').value = 'looks'")
    held.evaluate("document.getElementById('layer').dispatchEvent(new Event('change'))")
    assert held.evaluate("document.getElementById('detection-show').getAttribute('aria-pressed')") == "false"
    held.wait_for(f"window.tellAll('detection', {told(0.4)}) > 0")
    legend = "document.getElementById('legend')"
    assert held.evaluate(f"{legend}.hidden") is False
    assert "Number of looks" in held.evaluate(f"{legend}.textContent")


def test_the_bar_of_another_island_goes_at_once(held: Page) -> None:
    thermal = "document.getElementById('thermal')"
    held.evaluate("document.getElementById('open-islands').click()")
    held.wait_for("document.querySelector('[data-island=\"3\"]')")
    held.evaluate("document.querySelector('[data-island=\"3\"]').click()")
    bar = described("thermal", {"map_revision": 999, "scale": BAR})
    held.wait_for(f"window.tellAll('islands/3/thermal', {bar}) > 0 || !{thermal}.hidden")
    held.wait_for(f"!{thermal}.hidden")
    held.evaluate("document.querySelector('[data-island=\"0\"]').click()")
    held.wait_for("window.held.some((one) => one.path.includes('islands/0/thermal'))")
    assert held.evaluate(f"{thermal}.hidden")
