"""Looking, shared out: two tabs of a real Chromium, and what becomes of a patch when one is closed."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from threading import Event
from typing import Any
from urllib.parse import urlsplit

import pytest

from gcs_mosaic.notes.search import seen_ground
from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.stitch.camera.geometry import Pose
from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.views import flight_view
from gcs_mosaic.web.address import HttpAddress
from gcs_mosaic.web.api import looking as looking_api
from gcs_mosaic.web.api.looking import LookingAnswer
from gcs_mosaic.web.server import WebServer
from tests.factories import frame
from tests.sure import sure
from tests.web.browser import CHROMIUM, Page
from tests.web.seen_flight import CAMERA, seen_flight
from tests.web.served import served
from tests.web.small_flight import SmallFlight
from tests.web.test_looking_api import apart
from tests.web.test_notes_api import Writer

pytestmark = [pytest.mark.long, pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")]
TOLD = "document.getElementById('looking-told').textContent"
VIEW = "['map-pane', 'tile-container'].map((part) => document.querySelector(`.leaflet-${part}`).style.transform).join()"
LINES = "document.querySelectorAll('.leaflet-overlay-pane path').length"
BEGIN = "document.getElementById('looking-begin').click()"
# Also where it is told in the same words again.
COUNT = """void (() => {
  window.timesTold = 0;
  new MutationObserver(() => window.timesTold++).observe(document.getElementById("looking-told"), { childList: true });
})()"""

# All by the page's own clock, which is late together with what counts by it.
BY_ITSELF = """(async () => {
  const click = (id) => document.getElementById(id).click();
  const after = (ms) => new Promise((done) => setTimeout(done, ms));
  const told = async (id) => {
    const before = window.timesTold;
    click(id);
    while (window.timesTold === before) await after(20);
  };
  await told("looking-later"); // nothing of what comes next is counted yet
  %s
})()"""
GLANCE = """
  await after(500);
  click("phase-report");
  await after(1500);
  click("side-close");
  await told("looking-next");
"""
ZOOM_OUT = """
  for (let times = 0; times < 3; times++) {
    document.querySelector(".leaflet-control-zoom-out").click();
    await after(100);
    while (document.querySelector(".leaflet-zoom-anim")) await after(20);
  }
"""


@pytest.fixture
def flight(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> SmallFlight:
    for name in ("LEAST_REST_S", "MOST_REST_S"):
        monkeypatch.setattr(flight_view, name, 0.0)
    monkeypatch.setattr(looking_api, "SHOWN_S", 0.0)
    return seen_flight(tmp_path)


@pytest.fixture
def url(flight: SmallFlight, page: Page) -> Iterator[str]:
    server = WebServer(flight.root, HttpAddress("127.0.0.1", 0))
    yield server.start()
    page.open("about:blank")
    server.stop()


class Helper:
    """Somebody who looks at patches on a page."""

    def __init__(self, page: Page, url: str) -> None:
        self.page, self.answers = page, 0
        page.resize(500, 500)
        page.open(url)
        page.wait_for("document.querySelectorAll('.leaflet-tile-loaded img').length > 0")
        page.evaluate(COUNT)
        page.evaluate(BEGIN)
        page.wait_for(f"{TOLD} !== ''")

    def move(self, x: float = 200) -> None:
        self.page.command("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=150)

    def linger(self) -> None:
        self.move()
        time.sleep(1.4)
        self.move(201)

    def look(self, key: str = "ArrowRight") -> None:
        self.linger()
        self.press(key)

    def press(self, key: str = "ArrowRight") -> None:
        """Until the page has told what came of it."""
        before = self.page.evaluate("window.timesTold")
        self.page.key(key)
        self.page.wait_for(f"window.timesTold > {before}")


def share(page: Page) -> int:
    return int(page.evaluate(f"Number(/(\\d+) %/.exec({TOLD})[1])"))


def boxes(url: str) -> list[list[float]]:
    found = Writer(url).send(
        "POST", "/looking", {"session": "spy", "island": 0, "columns": 1, "lines": 1, "who": "spy"}
    )[1]
    Writer(url).send("POST", "/looking/leave", {"session": "spy"})
    return [one["box"] for one in found["others"]]


def test_two_tabs_have_no_patch_twice_and_a_closed_one_gives_its_back(page: Page, url: str) -> None:
    first, tab = Helper(page, url), page.another()
    second = Helper(tab, url)
    for _ in range(2):
        lent = boxes(url)
        assert len(lent) == 2
        assert apart(*lent)
        first.move()
        second.linger()  # and so does the first
        second.press("Enter")
        first.press()
        page.wait_for(f"!{TOLD}.startsWith('0 %')")
    before = share(page)
    assert 0 < before < 100
    tab.close()
    end = time.monotonic() + 5
    while len(now := boxes(url)) == 2:
        assert time.monotonic() < end, "a closed tab keeps its patch"
        time.sleep(0.1)
    assert len(now) == 1
    for _ in range(12):
        if "All of this part" in page.evaluate(TOLD):
            break
        first.look()
    assert page.evaluate(TOLD).startswith("All of this part is looked at.")
    assert share(page) == 100
    assert page.complaints == []


def test_an_island_that_is_cut_is_never_all_looked_at(page: Page, url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(seen_ground, "MOST_GROUND", 16)
    someone = Helper(page, url)
    for _ in range(9):
        assert "Ground farther out" in page.evaluate(TOLD)
        if page.evaluate(TOLD).startswith("100 %"):
            break
        someone.look()
        time.sleep(0.3)
    assert page.evaluate(TOLD).startswith("100 % of what is shared out")
    assert "All of this part" not in page.evaluate(TOLD)
    assert page.complaints == []


def test_who_does_not_look_is_not_counted(page: Page, url: str) -> None:
    """Half a second, and then a panel that lies over the map for longer than a look takes."""
    someone = Helper(page, url)
    someone.move()
    page.evaluate(BY_ITSELF % GLANCE)
    assert page.evaluate(TOLD).startswith("Too short")
    assert share(page) == 0
    someone.look()
    assert share(page) > 0


def test_who_reads_the_state_of_the_flight_does_not_look(page: Page, url: str) -> None:
    """Which lies over the map; it is closed when somebody begins to look."""
    someone = Helper(page, url)
    page.evaluate("document.getElementById('state').click()")
    someone.linger()
    page.key("ArrowRight")
    page.evaluate("document.getElementById('state').click()")
    page.evaluate("document.getElementById('looking-next').click()")
    time.sleep(0.5)
    assert share(page) == 0
    page.evaluate("document.getElementById('looking-end').click()")
    page.evaluate("document.getElementById('state').click()")
    page.evaluate(BEGIN)
    assert page.evaluate("document.getElementById('sheet').hidden")


def test_what_is_answered_after_the_end_is_given_back(page: Page, url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """And moves no map that somebody uses again."""
    Helper(page, url)
    page.evaluate("document.getElementById('looking-end').click()")
    end = time.monotonic() + 5
    while boxes(url):
        assert time.monotonic() < end, "a patch is not given back"
    original, asked = looking_api._next, Event()

    def late(*arguments: Any) -> LookingAnswer:
        asked.set()
        time.sleep(1.0)
        return original(*arguments)

    monkeypatch.setattr(looking_api, "_next", late)
    page.evaluate(BEGIN)
    assert asked.wait(5)
    page.evaluate("document.getElementById('looking-end').click()")
    page.evaluate("document.querySelector('.leaflet-control-zoom-out').click()")
    time.sleep(0.5)
    before = page.evaluate(VIEW), page.evaluate(LINES)
    time.sleep(1.5)
    monkeypatch.setattr(looking_api, "_next", original)
    assert (page.evaluate(VIEW), page.evaluate(LINES)) == before
    assert boxes(url) == []
    assert page.complaints == []


def test_who_has_zoomed_out_does_not_look(page: Page, url: str) -> None:
    """At which a person is a quarter as large; the page tells the zoom at which it was looked at, not that of the key."""
    someone = Helper(page, url)
    someone.move()
    page.evaluate(BY_ITSELF % ZOOM_OUT)
    someone.look()
    assert share(page) == 0
    assert page.complaints == []


def test_ground_that_was_painted_since_is_to_be_looked_at_again(page: Page, url: str, flight: SmallFlight) -> None:
    someone = Helper(page, url)
    someone.look()
    page.wait_for(f"!{TOLD}.startsWith('0 %')")
    counted = share(page)
    with Ledger(flight.root / LEDGER_NAME) as ledger:
        ledger.record_frame(frame("again.jpg", modified=1.7e9))
        ledger.record_size("again.jpg", CAMERA.width, CAMERA.height, 0.2)
        ledger.record_painted(
            RenderItem(name="again.jpg", order=99, island=0, pose=Pose(0.0, 0.0), camera=CAMERA, level=16)
        )
    flight.write()
    time.sleep(0.3)
    page.evaluate("document.getElementById('looking-later').click()")
    page.wait_for(f"Number(/(\\d+) %/.exec({TOLD})[1]) < {counted}")


def test_after_a_start_of_the_server_who_has_looked_goes_on(page: Page, flight: SmallFlight) -> None:
    """With the patch that was lent before; what was looked at stays so."""
    with served(flight.root) as url:
        someone = Helper(page, url)
        someone.look()
        counted, lent = share(page), boxes(url)
    assert counted > 0
    assert len(lent) == 1
    with served(flight.root, port=sure(urlsplit(url).port)):
        assert boxes(url) == lent
        someone.look()  # what that patch showed when it was lent is not known any more: it may not count
        assert share(page) >= counted
        someone.look()
        assert share(page) > counted
        page.open("about:blank")
