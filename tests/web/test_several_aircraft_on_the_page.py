"""Several aircraft on the page: each has a colour and a number, and any of them can be followed."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from gcs_mosaic.render.tile_grid import Tile
from gcs_mosaic.store.manifest import IslandEntry
from gcs_mosaic.store.records import Accounts
from gcs_mosaic.store.status import AircraftStatus, Behind
from gcs_mosaic.store.told_documents import FrameAccount
from gcs_mosaic.web.address import HttpAddress
from gcs_mosaic.web.feed import Feed
from gcs_mosaic.web.server import WebServer
from tests.web.browser import CHROMIUM, Page, open_browser
from tests.web.small_flight import GREEN, MIDDLE, SmallFlight

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")

BLUE_OF_1, ORANGE_OF_2 = "rgb(86, 180, 233)", "rgb(230, 159, 0)"
LEGEND = "[...document.querySelectorAll('#fleet button')].map((one) => one.innerText.replace(/\\s+/g, ' '))"
MARKS = """[...document.querySelectorAll(".aircraft-mark")].map((one) => [one.innerText, one.style.background])"""
FOLLOWED = "[...document.querySelectorAll('#fleet [aria-pressed=true] i')].map((one) => one.innerText)"


@pytest.fixture
def flight(tmp_path: Path) -> SmallFlight:
    """Two aircraft, the second with a frame that waits; and a third that has none on the map yet."""
    flight = SmallFlight(tmp_path)
    flight.islands = [IslandEntry(id=0, bounds=(0, 0, 1024, 1024), minzoom=14, maxzoom=16, frames=6)]
    for x in range(4):
        for y in range(4):
            flight.paint(Tile(16, MIDDLE + x, MIDDLE + y), GREEN)
    for k in range(3):
        flight.place(f"1/IMG_{k}.JPG", 150 + 200 * k, 200, vehicle=1)
        flight.place(f"2/IMG_{k}.JPG", 150 + 150 * k, 700, vehicle=2)
    flight.write()
    waiting = AircraftStatus(
        system=2, accounts=Accounts(frames=FrameAccount(placed=3, pending=4)), behind=Behind(frames=4)
    )
    flight.status(aircraft=(AircraftStatus(system=1), waiting, AircraftStatus(system=3)))
    return flight


@pytest.fixture
def page(tmp_path: Path, tmp_path_factory: pytest.TempPathFactory, flight: SmallFlight) -> Iterator[Page]:
    server = WebServer(tmp_path, HttpAddress("127.0.0.1", 0), Feed())
    url = server.start()
    with open_browser(tmp_path_factory.mktemp("profile")) as page:
        page.resize(1280, 800)
        page.open(url)
        yield page
    server.stop()


@pytest.mark.long
def test_each_aircraft_has_a_colour_and_can_be_followed(page: Page, tmp_path: Path) -> None:
    page.wait_for(f"{LEGEND}.length === 3 && {LEGEND}[0] !== '1 0 frames'")  # until the frames have come
    assert page.evaluate(LEGEND) == ["1 3 frames", "2 3 frames, 4 waiting", "3 0 frames"]
    page.wait_for(f"{MARKS}.length === 2")
    assert page.evaluate(MARKS) == [["1", BLUE_OF_1], ["2", ORANGE_OF_2]]
    page.evaluate("document.getElementById('flight-path').click()")
    page.evaluate("document.querySelectorAll('#fleet button')[0].click()")
    page.wait_for(f"{FOLLOWED}.join() === '1'")
    assert page.evaluate("document.getElementById('newest').getAttribute('aria-pressed')") == "true"
    page.screenshot(tmp_path / "followed.png")
    page.evaluate("document.querySelectorAll('#fleet button')[0].click()")
    page.wait_for(f"{FOLLOWED}.length === 0")
    assert page.evaluate("document.getElementById('aircraft').hidden")
    assert page.complaints == []


@pytest.mark.long
def test_a_lone_aircraft_needs_no_legend(page: Page, flight: SmallFlight) -> None:
    flight.estimates = flight.estimates[::2]
    flight.write()
    flight.status(aircraft=())
    page.open(page.evaluate("location.href"))
    page.wait_for("document.getElementById('counts').textContent.includes('Frames placed')")
    assert page.evaluate("document.getElementById('fleet').hidden")
    assert page.evaluate(MARKS) == []
