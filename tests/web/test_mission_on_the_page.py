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
