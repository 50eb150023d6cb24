"""What the page tells of places follows the map: in a real browser, beside a server that comes to know new frames late."""

from __future__ import annotations

import time
from collections.abc import Iterator

import pytest

from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.render.tile_grid import Tile
from gcs_mosaic.stitch.camera.geometry import Pose
from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.views import coverage, flight_view
from gcs_mosaic.web.feed import Feed
from tests.factories import frame
from tests.web.browser import CHROMIUM, Page
from tests.web.seen_flight import CAMERA, HOLE
from tests.web.served import served
from tests.web.small_flight import BLUE, MIDDLE, SmallFlight

pytestmark = [pytest.mark.long, pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")]

LATE_S = 2.0  # for which the server answers from what it read before
NEVER_S = 600.0  # no test lasts as long
WAIT_S = 20.0  # of a busy machine
GAPS = "document.querySelectorAll('#map path[stroke-dasharray]').length"
ASKED = "performance.getEntriesByType('resource').filter(({ name }) => name.includes('/gaps')).length"
TITLE = "document.getElementById('originals-title').innerText"
OPEN = "!document.getElementById('originals').hidden"


@pytest.fixture
def flight(flight: SmallFlight, monkeypatch: pytest.MonkeyPatch) -> SmallFlight:
    """Whose server reads it anew after two seconds only, however little that costs."""
    for name in ("LEAST_REST_S", "MOST_REST_S"):
        monkeypatch.setattr(flight_view, name, LATE_S)
        monkeypatch.setattr(coverage, name, 0.0)
    return flight


@pytest.fixture
def url(flight: SmallFlight, page: Page, feed: Feed) -> Iterator[str]:
    with served(flight.root, feed=feed) as address:
        yield address
        page.open("about:blank")


def rarely_read(monkeypatch: pytest.MonkeyPatch) -> None:
    """By time alone the server reads nothing again: only because it is asked for what is newer."""
    for module in (flight_view, coverage):
        for name in ("LEAST_REST_S", "MOST_REST_S"):
            monkeypatch.setattr(module, name, NEVER_S)


def fill_the_hole(flight: SmallFlight, feed: Feed) -> None:
    """The frame that was missing is painted: one revision, and nothing after it."""
    x, y = HOLE[0] * 200.0, HOLE[1] * 150.0
    with Ledger(flight.root / LEDGER_NAME) as ledger:
        ledger.record_frame(frame("late.jpg", modified=1.7e9))
        ledger.record_size("late.jpg", CAMERA.width, CAMERA.height, 0.2)
        ledger.record_painted(RenderItem(name="late.jpg", order=99, island=0, pose=Pose(x, y), camera=CAMERA, level=16))
    flight.place("late.jpg", x, y)
    tile = Tile(16, MIDDLE + 1, MIDDLE)
    flight.paint(tile, BLUE)
    feed.publish(flight.write(), [(0, tile)])


def test_a_gap_that_was_filled_goes_without_another_change(
    page: Page, url: str, flight: SmallFlight, feed: Feed
) -> None:
    page.open(url)
    page.wait_for(f"{GAPS} === 1")
    time.sleep(0.1)
    page.evaluate("fetch('/api/v1/islands/0/gaps').then((answer) => answer.text())")  # has just been read
    fill_the_hole(flight, feed)
    page.wait_for(f"{GAPS} === 0", WAIT_S)
    asked = page.evaluate(ASKED)
    time.sleep(2.0)
    assert page.evaluate(ASKED) == asked  # what is as new as the map is not asked for again


def test_a_layer_follows_the_map(page: Page, url: str, flight: SmallFlight, feed: Feed) -> None:
    page.open(url)
    page.wait_for("document.getElementById('layer').options.length > 1")
    page.evaluate(
        "(s => { s.value = 'looks'; s.dispatchEvent(new Event('change')); })(document.getElementById('layer'))"
    )
    page.wait_for("[...document.querySelectorAll('.layer-tile.leaflet-tile-loaded')].length > 0")
    fill_the_hole(flight, feed)
    revision = flight.manifest.revision
    page.wait_for(
        f"[...document.querySelectorAll('.layer-tile img')].some(({{ src }}) => /[?]r={revision}(&|$)/.test(src))",
        WAIT_S,
    )


def middle_of_the_hole(page: Page) -> list[float]:
    """On the screen."""
    found: list[float] = page.evaluate("""(() => {
      const box = document.querySelector("#map path[stroke-dasharray]").getBoundingClientRect();
      return [box.left + box.width / 2, box.top + box.height / 2];
    })()""")
    return found


def click(page: Page, place: list[float]) -> None:
    for kind in ("mousePressed", "mouseReleased"):
        page.command("Input.dispatchMouseEvent", type=kind, x=place[0], y=place[1], button="left", clickCount=1)


def test_a_click_on_ground_that_was_painted_a_moment_ago_opens_its_frame(
    page: Page, url: str, flight: SmallFlight, feed: Feed, monkeypatch: pytest.MonkeyPatch
) -> None:
    rarely_read(monkeypatch)
    page.open(url)
    page.wait_for(f"{GAPS} === 1")
    page.evaluate("fetch('/api/v1/islands/0/gaps').then((answer) => answer.text())")
    place = middle_of_the_hole(page)  # its outline goes as soon as it is filled
    fill_the_hole(flight, feed)
    revision = flight.manifest.revision
    page.wait_for(
        f"[...document.querySelectorAll('.leaflet-tile img')].some(({{ src }}) => /[?]r={revision}(&|$)/.test(src))"
    )
    click(page, place)
    page.wait_for(f"{OPEN} && {TITLE}.includes('late.jpg')", WAIT_S)


def test_where_nobody_looked_the_map_stays_in_sight(page: Page, url: str) -> None:
    page.open(url)
    page.wait_for(f"{GAPS} === 1")
    click(page, middle_of_the_hole(page))
    page.wait_for("document.getElementById('answer').innerText === 'No frame saw this place.'")
    assert not page.evaluate(OPEN)


def test_gaps_that_are_older_than_the_map_are_said_to_be(page: Page, url: str, flight: SmallFlight, feed: Feed) -> None:
    """As long as the server does not get to reading the flight."""
    page.open(url)
    page.wait_for(f"{GAPS} === 1")
    (flight.root / LEDGER_NAME).rename(flight.root / "away.sqlite")
    flight.paint(Tile(16, MIDDLE, MIDDLE), BLUE)
    feed.publish(flight.write(), [(0, Tile(16, MIDDLE, MIDDLE))])
    page.wait_for("document.getElementById('gaps').textContent === 'Gaps: 1 (older than the map)'", WAIT_S)
    (flight.root / "away.sqlite").rename(flight.root / LEDGER_NAME)
    page.wait_for("document.getElementById('gaps').textContent === 'Gaps: 1'", WAIT_S)


def test_what_the_page_asks_is_answered_as_of_its_revision(
    page: Page, url: str, flight: SmallFlight, feed: Feed, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A layer's tiles were made of a table that was read before, told no revision, and were not asked for again."""
    rarely_read(monkeypatch)
    page.open(url)
    page.wait_for("document.getElementById('layer').options.length > 1")
    page.evaluate(
        "(s => { s.value = 'looks'; s.dispatchEvent(new Event('change')); })(document.getElementById('layer'))"
    )
    page.wait_for(f"{GAPS} === 1")
    tile = f"api/v1/layers/looks/0/16/{MIDDLE + 1}/{MIDDLE}.png"
    alpha = f"""fetch("/{tile}?r=REVISION").then((answer) => answer.blob()).then(createImageBitmap).then((image) => {{
      const canvas = new OffscreenCanvas(256, 256).getContext("2d");
      canvas.drawImage(image, 0, 0);
      return canvas.getImageData(144, 150, 1, 1).data[3];
    }})"""  # canvas place (400, 150), the middle of the hole
    assert page.evaluate(alpha.replace("REVISION", "0")) == 0
    fill_the_hole(flight, feed)
    page.wait_for(f"{GAPS} === 0", WAIT_S)
    assert page.evaluate(alpha.replace("REVISION", str(flight.manifest.revision))) == 255
    told = f"""fetch("/{tile}?r={flight.manifest.revision}").then((answer) => answer.headers.get("Map-Revision"))"""
    assert page.evaluate(told) == str(flight.manifest.revision)
    again = "[...document.querySelectorAll('.layer-tile img')].every(({ src }) => src.includes('&again='))"
    page.wait_for(again, WAIT_S)  # also where nothing was painted: what is usual may have changed
