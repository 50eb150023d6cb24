"""A mission over the gaps is asked for on the page, and what stands against it is said there."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from gcs_mosaic.web.address import HttpAddress
from gcs_mosaic.web.server import WebServer
from tests.handover.gapped import gapped_flight
from tests.web.browser import CHROMIUM, Page, open_browser

pytestmark = [pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine"), pytest.mark.long]

HEAR = """void (() => {
  const made = URL.createObjectURL;
  URL.createObjectURL = (data) => {
    data.text().then((text) => { window.saved = text; });
    return made(data);
  };
})()"""
IS_ALARM = "document.getElementById('mission-said').matches('[role=alert]')"
IS_IN_SIGHT = "document.getElementById('mission-said').getBoundingClientRect().bottom <= innerHeight"
SAID = "document.getElementById('mission-said').textContent"


@contextmanager
def at_the_panel(root: Path, profile: Path) -> Iterator[Page]:
    server = WebServer(root, HttpAddress("127.0.0.1", 0))
    with open_browser(profile) as page:
        page.open(server.start())
        page.wait_for("document.getElementById('open-mission')")
        page.evaluate(HEAR)
        page.evaluate("document.getElementById('open-mission').click()")
        yield page
    server.stop()


def save(page: Page) -> None:
    page.evaluate("document.querySelector('#mission-form button').click()")


def test_the_mission_is_saved(tmp_path: Path) -> None:
    with at_the_panel(gapped_flight(tmp_path / "flight"), tmp_path / "profile") as page:
        page.evaluate("document.querySelector('#mission-form [name=format]').value = 'waypoints'")
        page.evaluate("document.querySelector('#mission-form [name=height]').value = '80,5'")
        save(page)
        page.wait_for("window.saved?.startsWith('QGC WPL 110')")
        assert "\t80.50000000\t" in page.evaluate("window.saved")
        assert "advice" in page.evaluate(SAID)
        assert page.evaluate(IS_ALARM) is False
        assert page.evaluate(IS_IN_SIGHT)


def test_why_there_is_none_is_said(tmp_path: Path) -> None:
    with at_the_panel(gapped_flight(tmp_path / "flight", pinned=False), tmp_path / "profile") as page:
        save(page)
        page.wait_for(f"{SAID}.includes('anchor')")
        assert page.evaluate(IS_ALARM)
        assert page.evaluate(IS_IN_SIGHT)
        assert page.evaluate("window.saved ?? null") is None


CANOPY = "document.getElementById('canopy-form')"
POINT = """import('/viewer/page.js').then(({ modules: { pointing: { Pointing } } }) => {
  const { take } = Pointing.prototype;
  Pointing.prototype.take = function (tool) {
    window.tool = tool;
    take.call(this, tool);
  };
})"""


def draw(page: Page, *corners: tuple[float, float]) -> None:
    page.wait_for("document.querySelector('#map .leaflet-layer')")
    page.evaluate(POINT)
    page.evaluate("document.getElementById('canopy-draw').click()")
    for x, y in corners:
        page.evaluate(f"void window.tool.place(0, {x}, {y})")


def test_it_says_how_to_fly_for_many_looks_and_saves_a_mission_over_an_area(tmp_path: Path) -> None:
    with at_the_panel(gapped_flight(tmp_path / "flight"), tmp_path / "profile") as page:
        page.evaluate(f"{CANOPY}.elements.looks.value = '9'; {CANOPY}.dispatchEvent(new Event('input'))")
        told = "document.getElementById('canopy-told').textContent"
        page.wait_for(f"{told}.includes('9 looks: 67 % overlap along, 67 % across')")
        # Frames of 30 m on their shorter side, one each second, as `gapped_flight` has them.
        assert "A frame each 10.0 m, lines 10.0 m apart, 10.0 cm a pixel." in page.evaluate(told)
        assert "With a frame each 1 s, as in this flight: 10.0 m/s at most." in page.evaluate(told)
        assert page.evaluate("document.getElementById('canopy-save').disabled")
        draw(page, (300, 200), (700, 200), (700, 400), (300, 400))
        page.evaluate("document.querySelector('#mission-form [name=format]').value = 'waypoints'")
        page.evaluate("document.getElementById('canopy-save').click()")
        page.wait_for("window.saved?.startsWith('QGC WPL 110')")
        assert "advice" in page.evaluate("document.getElementById('canopy-said').textContent")


def test_an_outline_without_ground_is_refused_in_a_sentence(tmp_path: Path) -> None:
    with at_the_panel(gapped_flight(tmp_path / "flight"), tmp_path / "profile") as page:
        draw(page, (300, 200), (500, 200), (700, 200))
        page.evaluate("document.getElementById('canopy-save').click()")
        page.wait_for("document.getElementById('canopy-said').textContent.includes('no ground')")
        assert page.evaluate("window.saved ?? null") is None
