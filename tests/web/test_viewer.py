from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import replace
from itertools import count
from pathlib import Path
from urllib.parse import urlsplit

import cv2
import pytest
from aiohttp import web

from gcs_mosaic.messages import LinkReport, Refusals
from gcs_mosaic.render.tile_grid import Tile
from gcs_mosaic.stitch.camera.geometry import Pose
from gcs_mosaic.stitch.graph.tearing import HeldOut
from gcs_mosaic.store.manifest import IslandEntry
from gcs_mosaic.store.records import Accounts
from gcs_mosaic.store.status import Behind, Condition, LastFrame
from gcs_mosaic.store.told_documents import FrameAccount
from gcs_mosaic.web import access
from gcs_mosaic.web import live as live_module
from gcs_mosaic.web.address import HttpAddress
from gcs_mosaic.web.feed import Feed
from gcs_mosaic.web.server import WebServer
from gcs_mosaic.web.settings import WebSettings
from gcs_mosaic.web.token import Access
from tests.running import until
from tests.sure import sure
from tests.web.browser import CHROMIUM, Page
from tests.web.small_flight import BLUE, GREEN, MIDDLE, RED, SmallFlight
from tests.web.test_app import Client, Live

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")

COLOURS = """
(() => [...document.querySelectorAll(".leaflet-tile img")].filter((i) => i.complete && i.naturalWidth).map((image) => {
  const canvas = new OffscreenCanvas(1, 1).getContext("2d");
  canvas.drawImage(image, 100, 100, 1, 1, 0, 0, 1, 1);
  const [r, g, b, a] = canvas.getImageData(0, 0, 1, 1).data;
  const name = a < 128 ? "none" : r > 128 ? "red" : g > 128 ? "green" : b > 128 ? "blue" : "black";
  return new URL(image.src).pathname + " " + name;
}))()
"""
# All that is told, also behind the line of state.
TEXT = "(document.getElementById('sheet')?.removeAttribute('hidden'), document.body.innerText)"


@pytest.fixture
def flight(tmp_path: Path) -> SmallFlight:
    return SmallFlight(tmp_path)


@pytest.fixture
def url(tmp_path: Path, page: Page, feed: Feed) -> Iterator[str]:
    server = WebServer(tmp_path, HttpAddress("127.0.0.1", 0), feed)
    yield server.start()
    page.open("about:blank")
    server.stop()


def square(level: int) -> Tile:
    """The tile of a level at the canvas' origin."""
    return Tile(level, MIDDLE >> (16 - level), MIDDLE >> (16 - level))


def at(tile: Tile, colour: str, island: int = 0) -> str:
    return f'{COLOURS}.includes("/tiles/{island}/{tile.z}/{tile.x}/{tile.y} {colour}")'


def test_tiles_are_shown_and_exchanged_when_told(page: Page, url: str, feed: Feed, flight: SmallFlight) -> None:
    first = square(16)
    beside, far = Tile(16, first.x + 1, first.y), Tile(16, first.x, first.y + 1)
    for tile in (first, beside, far):
        flight.paint(tile, RED)
    flight.place("a.jpg", 128, 128)
    flight.islands = [IslandEntry(id=0, bounds=(0, 0, 800, 512), minzoom=14, maxzoom=16, frames=1)]
    feed.publish(flight.write(), [(0, first)])
    flight.status()
    page.open(url)
    page.wait_for(at(first, "red"))
    page.wait_for(at(far, "red"))
    page.wait_for("!document.querySelector('.on-its-way, .leaflet-tile:not(.leaflet-tile-loaded)')")
    page.evaluate("window.sameDocument = [...document.querySelectorAll('.leaflet-tile img')].length")
    before = len(page.requests)
    flight.paint(first, GREEN)
    feed.publish(flight.write(), [(0, first), (0, first.parent)])
    page.wait_for(at(first, "green"))
    page.wait_for(f"{TEXT}.includes('Frames placed')")
    fetched = {request.split("?")[0] for request in page.requests[before:] if "/tiles/" in request}
    assert fetched == {f"{url}tiles/0/16/{first.x}/{first.y}"}
    assert page.evaluate("window.sameDocument") > 0
    assert page.complaints == []


@pytest.mark.long
def test_a_page_that_nobody_sees_lets_go_of_its_connection_and_is_new_when_it_is_seen_again(
    page: Page, url: str, feed: Feed, flight: SmallFlight
) -> None:
    tile = square(16)
    flight.paint(tile, RED)
    flight.write()
    page.open(url)
    page.wait_for(at(tile, "red"))
    until(lambda: feed.subscribers == 1, "it listens")
    page.evaluate("import('/viewer/page.js').then(({ modules }) => { modules.live.Live.restsAfterMs = 100; })")
    page.evaluate("Object.defineProperty(document, 'hidden', { get: () => window.isUnseen, configurable: true })")
    page.evaluate("isUnseen = true; document.dispatchEvent(new Event('visibilitychange'))")
    until(lambda: feed.subscribers == 0, "it has let go")
    flight.paint(tile, BLUE)
    feed.publish(flight.write(), [(0, tile)])
    page.evaluate("isUnseen = false; document.dispatchEvent(new Event('visibilitychange'))")
    until(lambda: feed.subscribers == 1, "it listens again")
    page.wait_for(at(tile, "blue"))


@pytest.mark.long
def test_page_asks_nothing_of_any_other_host(page: Page, url: str, flight: SmallFlight) -> None:
    page.requests.clear()
    flight.paint(square(16), RED)
    flight.place("a.jpg", 128, 128)
    flight.write()
    flight.status()
    page.open(url)
    page.wait_for(at(square(16), "red"))
    assert page.hosts() == {url.split("/")[2]}


@pytest.mark.long
def test_growing_island_gets_new_tiles_without_reload(page: Page, url: str, feed: Feed, flight: SmallFlight) -> None:
    flight.islands = [IslandEntry(id=0, bounds=(0, 0, 256, 256), minzoom=14, maxzoom=16, frames=1)]
    flight.paint(square(16), RED)
    flight.place("a.jpg", 128, 128)
    feed.publish(flight.write(), None)
    page.open(url)
    page.wait_for(at(square(16), "red"))
    page.evaluate("window.sameDocument = true")
    grown = Tile(16, MIDDLE + 2, MIDDLE)
    flight.paint(grown, BLUE)
    flight.place("b.jpg", 640, 128)
    flight.islands = [IslandEntry(id=0, bounds=(0, 0, 768, 256), minzoom=14, maxzoom=16, frames=2)]
    feed.publish(flight.write(), [(0, grown)])
    page.wait_for(at(grown, "blue"))
    assert page.evaluate("window.sameDocument")


@pytest.mark.long
def test_islands_can_be_chosen(page: Page, url: str, flight: SmallFlight) -> None:
    both = [IslandEntry(id=n, bounds=(0, 0, 256, 256), minzoom=14, maxzoom=16, frames=5 - n) for n in (0, 1)]
    flight.islands = both
    flight.paint(square(16), RED, island=0)
    flight.paint(square(16), BLUE, island=1)
    flight.write()
    page.open(url)
    page.wait_for(at(square(16), "red"))
    page.evaluate("document.getElementById('parts').click()")
    page.evaluate("document.querySelector('[data-island=\"1\"]').click()")
    page.wait_for(at(square(16), "blue", island=1))


@pytest.mark.long
def test_how_well_the_island_in_view_fits_is_told(page: Page, url: str, flight: SmallFlight) -> None:
    known = {0: HeldOut(1.93, 9.12, 3120), 1: HeldOut(14.2, math.inf, 88), 2: None}
    flight.islands = [
        IslandEntry(id=n, bounds=(0, 0, 256, 256), minzoom=14, maxzoom=16, frames=5 - n, held_out=found)
        for n, found in known.items()
    ]
    flight.paint(square(16), RED)
    flight.write()
    flight.status()
    page.open(url)
    page.wait_for(f"{TEXT}.includes('Fits to\\n1.9 px\\n95 %: 9.1')")
    page.evaluate("document.getElementById('parts').click()")
    choose = "document.querySelector('[data-island=\"%d\"]').click()"
    page.evaluate(choose % 1)
    page.wait_for(f"{TEXT}.includes('14 px\\n95 %: ∞')")
    page.evaluate(choose % 2)
    page.wait_for(f"!{TEXT}.includes('Fits to')")


@pytest.mark.long
def test_following_shows_the_newest_frame_where_it_is(page: Page, url: str, feed: Feed, flight: SmallFlight) -> None:
    flight.islands = [IslandEntry(id=0, bounds=(0, 0, 256, 256), minzoom=10, maxzoom=16, frames=1)]
    flight.place("a.jpg", 128, 128)
    flight.paint(square(16), RED)
    feed.publish(flight.write(), None)
    page.open(url)
    page.wait_for(at(square(16), "red"))
    page.evaluate("document.getElementById('newest').click()")
    far = Tile(16, MIDDLE + 40, MIDDLE)
    flight.place("b.jpg", 40 * 256 + 128, 128)
    flight.paint(far, BLUE)
    flight.islands = [IslandEntry(id=0, bounds=(0, 0, 10496, 256), minzoom=10, maxzoom=16, frames=2)]
    feed.publish(flight.write(), [(0, far)])
    page.wait_for(
        "(box => box && box.left >= 0 && box.right <= innerWidth)"
        "(document.querySelector('path.leaflet-interactive, .leaflet-overlay-pane path')?.getBoundingClientRect())"
    )
    page.wait_for(f"{COLOURS}.some(tile => tile.endsWith('blue'))")


OUTLINE = "document.querySelector('.leaflet-overlay-pane path')?.getBoundingClientRect().left"


@pytest.mark.long
def test_the_list_of_all_frames_is_read_once(page: Page, url: str, feed: Feed, flight: SmallFlight) -> None:
    flight.place("a.jpg", 128, 128)
    flight.paint(square(16), RED)
    feed.publish(flight.write(), None)
    page.open(url)
    page.wait_for(f"{OUTLINE} > 0")
    for name, x in (("b.jpg", 200), ("c.jpg", 300)):
        page.evaluate(f"window.before = {OUTLINE}")
        flight.place(name, x, 128)
        feed.publish(flight.write(), [])
        page.wait_for(f"{OUTLINE} > window.before + 20")
    read = [urlsplit(address) for address in page.requests if address.startswith(url)]  # not those of other tests
    asked = [part.query for part in read if part.path == "/placements.jsonl"]
    assert asked.count("after=0") == 1
    assert {"after=1", "after=2"} <= set(asked)  # a late event may make it ask twice for the same
    assert "/placements.json" not in [part.path for part in read]


@pytest.mark.long
def test_a_page_that_missed_the_journal_reads_all_frames(page: Page, url: str, feed: Feed, flight: SmallFlight) -> None:
    flight.place("a.jpg", 128, 128)
    flight.paint(square(16), RED)
    flight.write()
    page.open(url)
    page.wait_for(f"{OUTLINE} > 0")
    page.evaluate(f"window.before = {OUTLINE}")
    (flight.root / "placements.jsonl").unlink()
    flight.place("b.jpg", 300, 128)
    flight.write()
    (flight.root / "placements.jsonl").unlink()
    feed.publish(flight.manifest.revision, [])
    page.wait_for(f"{OUTLINE} > window.before + 20")


@pytest.mark.long
def test_the_outline_follows_a_covered_frame(page: Page, url: str, feed: Feed, flight: SmallFlight) -> None:
    flight.place("a.jpg", 128, 128)
    flight.paint(square(16), RED)
    feed.publish(flight.write(), None)
    flight.status()
    page.open(url)
    page.wait_for(at(square(16), "red"))
    page.wait_for(f"{OUTLINE} > 0")
    page.evaluate(f"window.before = {OUTLINE}")
    assert not page.evaluate(f"/covered/i.test({TEXT})")
    flight.cover("b.jpg", "a.jpg", 100, 0)
    feed.publish(flight.write(), [])
    page.wait_for(f"{OUTLINE} > window.before + 20")
    page.evaluate(f"window.before = {OUTLINE}")
    (keyframe,), covered, flight.covered = flight.estimates, flight.covered, []
    flight.estimates = [replace(keyframe, pose=Pose(228, 128))]
    feed.publish(flight.write(newest="b.jpg"), [])
    page.wait_for(f"{OUTLINE} > window.before + 20")
    flight.covered = covered
    last = LastFrame(name="b.jpg", outcome="covered", island=None, utc=1e9, seconds_to_tile=None, covered_by="a.jpg")
    flight.status(last_frame=last, accounts=Accounts(frames=FrameAccount(placed=1, covered=1)))
    page.wait_for(f"/covered\\s*1/i.test({TEXT})")
    page.wait_for("Boolean(document.querySelector('[title=\"b.jpg: covered by a.jpg\"]'))")


@pytest.mark.long
def test_empty_page_says_what_is_waited_for(page: Page, url: str, flight: SmallFlight) -> None:
    flight.status(state="listening", last_frame=None)
    page.open(url)
    page.wait_for(f"{TEXT}.includes('No frame yet') && {TEXT}.includes('udp:14550')")
    page.wait_for(f"{TEXT}.includes('Listening') && {TEXT}.includes('Watching frames: no frame')")


@pytest.mark.long
def test_silent_daemon_is_not_shown_as_flying(page: Page, url: str, flight: SmallFlight) -> None:
    flight.write()
    flight.status(updated_utc=1714564800.0)
    page.open(url)
    page.wait_for(f"{TEXT}.includes('has not shown a sign of life for')")
    assert not page.evaluate(f"{TEXT}.includes('Flying')")


@pytest.mark.long
def test_how_far_behind_the_map_is_is_told(page: Page, url: str, flight: SmallFlight) -> None:
    flight.write()
    flight.status(behind=Behind(frames=12, seconds=40.2))
    page.open(url)
    page.wait_for(f"{TEXT}.includes('12 frames, 40 s behind')")
    flight.status()
    page.wait_for(f"!{TEXT}.includes('behind')")


@pytest.mark.long
def test_what_a_link_left_out_is_shown(page: Page, url: str, flight: SmallFlight) -> None:
    flight.write()
    flight.status()
    page.open(url)
    page.wait_for(f"{TEXT}.includes('Flying')")
    assert not page.evaluate(f"/of aircraft|refused/i.test({TEXT})")
    link = LinkReport(
        address="udp:1", state="heard", followed=3, others=((4, 20), (9, 1)), refused=Refusals(unsigned=5)
    )
    flight.status(mavlink=(link, replace(link, others=((4, 22),), refused=Refusals(replayed=3))))
    page.wait_for(f"/of aircraft 4, 9\\s*23/i.test({TEXT}) && /packets refused\\s*8/i.test({TEXT})")
    assert page.evaluate(
        "Boolean(document.querySelector('[title^=\"22 triggers of system 4, 1 triggers of system 9\"]'))"
    )


def later(page: Page, seconds: float) -> None:
    """So much later by the page's clock."""
    page.evaluate(f"(now => {{ Date.now = () => now() + {seconds * 1000}; }})(Date.now)")


def shown_here(page: Page, url: str, flight: SmallFlight) -> None:
    """The page is open, and shows a red tile of revision 1; `sameDocument` is true until it is loaded again."""
    flight.islands = [IslandEntry(id=0, bounds=(0, 0, 256, 256), minzoom=14, maxzoom=16, frames=1)]
    flight.paint(square(16), RED)
    flight.write()
    flight.status(revision=flight.manifest.revision)
    page.open(url)
    page.wait_for(at(square(16), "red"))
    page.evaluate("window.sameDocument = true")


async def no_farewell(_response: web.StreamResponse) -> None:
    raise ConnectionError


def offline(page: Page, *, is_away: bool) -> None:
    page.command(
        "Network.emulateNetworkConditions", offline=is_away, latency=0, downloadThroughput=-1, uploadThroughput=-1
    )


LOADED = "[...document.querySelectorAll('.leaflet-tile-loaded img')].filter((i) => i.src.includes('/tiles/')).length"
NOT_LOADED = "document.querySelectorAll('.leaflet-tile.not-loaded').length"


@pytest.mark.long
def test_tiles_that_fail_are_asked_for_again_and_look_otherwise_than_what_nobody_has_seen(
    page: Page, url: str, flight: SmallFlight
) -> None:
    """The Wi-Fi of a tablet goes, somebody zooms, and it comes back."""
    shown_here(page, url, flight)
    assert page.evaluate(NOT_LOADED) == 0  # there is ground around that nobody has seen
    offline(page, is_away=True)
    for _ in range(4):
        page.evaluate("document.querySelector('.leaflet-control-zoom-out').click()")
        time.sleep(0.4)
    page.wait_for(f"{NOT_LOADED} > 0")
    assert page.evaluate(LOADED) > 0  # what was shown is still there below
    offline(page, is_away=False)
    page.wait_for(f"{NOT_LOADED} === 0 && {LOADED} > 0", timeout_s=20)
    assert page.evaluate("window.sameDocument")


@pytest.mark.long
def test_scrolling_out_does_not_freeze_the_page(page: Page, url: str, flight: SmallFlight) -> None:
    shown_here(page, url, flight)
    page.evaluate(
        "window.longest = 0; new PerformanceObserver((list) => list.getEntries().forEach((task) => {"
        " window.longest = Math.max(window.longest, task.duration) })).observe({type: 'longtask'})"
    )
    for direction in (1, -1):
        for _ in range(30):
            page.command("Input.dispatchMouseEvent", type="mouseWheel", x=640, y=400, deltaX=0, deltaY=direction * 400)
    page.wait_for(f"{NOT_LOADED} === 0")
    time.sleep(0.5)
    assert page.evaluate("window.longest") <= 200


@pytest.mark.long
def test_something_is_shown_all_the_time_while_the_map_grows(
    page: Page, url: str, feed: Feed, flight: SmallFlight
) -> None:
    """Looked at each 25 ms: once a tile was shown, there is never none, also while "Whole map" changes the zoom level."""
    shown_here(page, url, flight)
    page.evaluate(f"window.least = 99; setInterval(() => {{ window.least = Math.min(window.least, {LOADED}) }}, 25)")
    for step in range(1, 8):
        side = 512 << (step // 2)
        tile = Tile(16, MIDDLE + (side >> 8) - 1, MIDDLE)
        flight.paint(tile, BLUE)
        flight.place(f"{step}.jpg", side - 128.0, 128)
        flight.islands = [IslandEntry(id=0, bounds=(0, 0, side, side), minzoom=16 - step, maxzoom=16, frames=step)]
        feed.publish(flight.write(), [(0, tile)])
        time.sleep(0.25)
    assert page.evaluate("window.least") > 0


@pytest.mark.long
def test_a_good_end_does_not_look_like_a_crash(page: Page, tmp_path: Path, flight: SmallFlight) -> None:
    said = {}
    flight.place("a.jpg", 128, 128)
    for state in ("stopped", "flying"):
        server = WebServer(tmp_path, HttpAddress("127.0.0.1", 0), Feed())
        shown_here(page, server.start(), flight)
        flight.status(state=state, flight="alm & hof")
        server.stop()
        page.wait_for("[...document.querySelectorAll('#farewell, #alarm')].some((one) => !one.hidden)")
        said[state] = page.evaluate("document.getElementById('state').className + ' ' + document.body.innerText")
        page.open("about:blank")
    assert said["stopped"].startswith("calm")
    assert "Ended, map complete, 1 frame. To open it again: gcs-mosaic serve 'alm & hof'" in said["stopped"]
    assert said["flying"].startswith("bad")
    assert "it crashed or was killed" in said["flying"]


@pytest.mark.long
def test_a_clock_that_is_set_in_flight_is_no_daemon_that_hangs(
    page: Page, url: str, flight: SmallFlight, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A field laptop finds its time: what was written before seems to be hours old, until it is written again."""
    flight.place("a.jpg", 128, 128)
    flight.write()
    flight.status()
    page.open(url)
    page.wait_for("document.getElementById('state').className === 'good'")
    page.evaluate(
        "window.seen = new Set(); "
        "setInterval(() => window.seen.add(document.querySelector('#state b').textContent), 20)"
    )
    now = time.time
    monkeypatch.setattr(time, "time", lambda: now() + 5 * 3600)
    time.sleep(2.0)
    flight.status()
    time.sleep(1.5)
    assert page.evaluate("[...window.seen]") == ["Flying"]


@pytest.mark.long
def test_a_flight_that_ends_while_its_folder_is_gone_is_not_called_crashed_nor_offered_by_its_name(
    page: Page, flight: SmallFlight
) -> None:
    """Somebody has renamed it: with the same words another flight would begin."""
    flight.place("a.jpg", 128, 128)
    elsewhere = flight.root.with_name(f"{flight.root.name} renamed")
    for state, onward, title in (
        ("flying", "Start it again with the same words", "Flying"),
        ("stopped", "To open it again", "Flight ended"),
    ):
        server = WebServer(flight.root, HttpAddress("127.0.0.1", 0), Feed())
        shown_here(page, server.start(), flight)
        flight.status(state=state)
        page.wait_for(f"document.querySelector('#state b').textContent === '{title}'")
        flight.root.rename(elsewhere)
        page.wait_for("document.querySelector('#state b').textContent === 'Folder gone'")
        server.stop()
        page.wait_for("document.getElementById('alarm').innerText.includes('has ended while')")
        said = page.evaluate("document.body.innerText")
        assert "put it back where it was" in said
        assert onward in said
        assert "crashed" not in said
        page.open("about:blank")
        elsewhere.rename(flight.root)


def ended(page: Page, flight: SmallFlight, *lasting: Condition) -> tuple[str, str, str]:
    """What the page says when a flight has ended under its eyes: the state's kind and text, and the farewell."""
    server = WebServer(flight.root, HttpAddress("127.0.0.1", 0), Feed())
    flight.write()
    flight.status()
    page.open(server.start())
    page.wait_for("document.getElementById('state').className === 'good'")
    flight.status(state="stopped", conditions=lasting)
    page.wait_for("document.querySelector('#state b').textContent === 'Flight ended'")
    server.stop()
    page.wait_for("!document.getElementById('farewell').hidden")
    state, farewell = (f"document.getElementById('{name}')" for name in ("state", "farewell"))
    kind, *texts = (
        " ".join(page.evaluate(text).split())
        for text in (f"{state}.className", f"{state}.innerText", f"{farewell}.innerText")
    )
    shown = page.evaluate("[...document.querySelectorAll('#conditions li')].map((line) => line.textContent)")
    assert shown == [one.text for one in lasting]
    assert page.evaluate("document.getElementById('chip').hidden") == (not lasting)
    page.open("about:blank")
    return kind, texts[0], texts[1]


@pytest.mark.long
def test_a_flight_that_has_ended_tells_what_lasts_and_is_complete_only_in_one_part(
    page: Page, flight: SmallFlight
) -> None:
    flight.place("a.jpg", 128, 128)
    flight.rejected = 1
    kind, state, farewell = ended(page, flight)
    assert (kind, state) == ("calm", "Flight ended map final, 1 frame")
    assert farewell.startswith("Ended, map final, 1 frame.")
    flight.rejected = 0
    flight.islands.append(replace(flight.islands[0], id=1))
    parts = Condition(key="islands", level="warning", text="The map is in 2 parts", since_utc=time.time())
    pairing = replace(parts, key="pairing", level="info", text="Which trigger belongs to which picture is ambiguous")
    kind, state, farewell = ended(page, flight, parts, pairing)
    assert (kind, state) == ("warn", "Flight ended The map is in 2 parts")
    assert farewell.startswith("Ended, map final, 1 frame.")


@pytest.mark.long
def test_what_lasts_is_shown_by_how_bad_it_is_and_as_text(page: Page, url: str, flight: SmallFlight) -> None:
    condition = Condition(key="overlap", level="warning", text="<b>fly</b> back", since_utc=time.time())
    flight.status(conditions=(condition, replace(condition, key="behind", level="info", text="9 s behind")))
    page.open(url)
    page.wait_for("document.querySelectorAll('#conditions li').length === 2")
    assert page.evaluate(
        "[...document.querySelectorAll('#conditions li')].map((li) => li.className + ' ' + li.innerText)"
    ) == [
        "warning <b>fly</b> back",
        "info 9 s behind",
    ]
    flight.status()
    page.wait_for("document.querySelectorAll('#conditions li').length === 0")


def chosen(page: Page, name: str, value: str) -> None:
    page.evaluate(
        f"(() => {{ const input = document.getElementById('look-{name}'); input.value = '{value}';"
        " input.dispatchEvent(new Event('input')) }})()".replace("}})", "})")
    )


def middle(page: Page, folder: Path) -> tuple[float, float, float]:
    """Mean colour in the middle of the map as it is seen: red, green, blue."""
    page.screenshot(folder / "seen.png")
    seen = cv2.imread(str(folder / "seen.png"))
    assert seen is not None
    blue, green, red = seen[380:420, 560:600].reshape(-1, 3).mean(axis=0).tolist()
    return red, green, blue


COLOURED = """[...document.querySelectorAll("#side :is(img, input[type=checkbox], input[type=range])")]
  .map((one) => one.getBoundingClientRect()).filter(({ width, height }) => width > 4 && height > 4)
  .map(({ left, top, right, bottom }) => [left + 2, top + 2, right - 2, bottom - 2].map(Math.round))"""


@pytest.mark.long
def test_dark_ground_can_be_lightened_and_the_night_is_red(
    page: Page, url: str, flight: SmallFlight, tmp_path: Path
) -> None:
    flight.paint(square(16), (40, 40, 40))
    flight.islands = [IslandEntry(id=0, bounds=(0, 0, 256, 256), minzoom=14, maxzoom=16, frames=1)]
    flight.write()
    page.open(url)
    page.evaluate('localStorage.setItem(\'gcs-mosaic look\', \'{"gamma": "<b>", "theme": 3}\')')  # somebody else's
    page.open("about:blank")
    page.open(url)
    page.wait_for(f"{LOADED} > 0")
    as_it_came = middle(page, tmp_path)
    assert as_it_came == pytest.approx((40, 40, 40), abs=4)
    chosen(page, "gamma", "2")
    assert min(middle(page, tmp_path)) > 80
    page.open("about:blank")
    page.open(url)  # it is kept
    page.wait_for(f"{LOADED} > 0")
    assert min(middle(page, tmp_path)) > 80
    chosen(page, "theme", "night")
    red, green, blue = middle(page, tmp_path)
    assert red > 40
    assert max(green, blue) < 16
    for panel in ("islands", "anchors", "look"):  # pictures, boxes and sliders beside the map
        page.evaluate(f"document.getElementById('open-{panel}').click()")
        page.wait_for(f"{COLOURED}.length > 0")
        page.screenshot(tmp_path / "seen.png")
        seen = sure(cv2.imread(str(tmp_path / "seen.png")))
        for left, top, right, bottom in page.evaluate(COLOURED):
            blue, green, red = seen[top:bottom, left:right].reshape(-1, 3).mean(axis=0).tolist()
            assert max(blue, green) < 0.5 * red, panel
    page.evaluate("document.getElementById('side-close').click()")
    page.evaluate("document.getElementById('look-plain').click()")
    assert middle(page, tmp_path) == pytest.approx(as_it_came, abs=1)
    page.evaluate("localStorage.clear()")


@pytest.mark.long
def test_in_the_system_s_own_colours_what_is_on_still_looks_otherwise(page: Page, url: str) -> None:
    """As high contrast asks for; the light of the state keeps its colour, too."""
    page.command("Emulation.setEmulatedMedia", features=[{"name": "forced-colors", "value": "active"}])
    page.open(url)
    page.wait_for("document.querySelector('#state b').textContent")
    page.evaluate("document.querySelector('#tools button').click()")
    page.wait_for("document.querySelector('#tools [aria-expanded=true]')")
    colour = "getComputedStyle(document.querySelector('{}')).backgroundColor"
    assert page.evaluate(colour.format("#tools [aria-expanded=true]")) != page.evaluate(
        colour.format("#tools [aria-expanded=false]")
    )
    page.evaluate("document.querySelector('#all').setAttribute('aria-pressed', 'true')")
    assert page.evaluate(colour.format("#all")) != page.evaluate(colour.format("#newest"))
    assert page.evaluate(colour.format("#state i")) != page.evaluate(colour.format("body"))


def another_revision(flight: SmallFlight) -> None:
    flight.paint(square(16), GREEN)
    flight.write()
    flight.status(revision=flight.manifest.revision)


@pytest.mark.long
def test_what_was_shown_stays_while_the_server_is_away_and_goes_on_when_it_is_back(
    page: Page, tmp_path: Path, flight: SmallFlight, monkeypatch: pytest.MonkeyPatch
) -> None:
    server = WebServer(tmp_path, HttpAddress("127.0.0.1", 0), Feed())
    url = server.start()
    shown_here(page, url, flight)
    monkeypatch.setattr(live_module, "say_farewell", no_farewell)  # as a process that is killed
    server.stop()
    later(page, 6)
    page.wait_for(f"{TEXT}.includes('No connection to gcs-mosaic')", timeout_s=15)
    assert page.evaluate("getComputedStyle(document.getElementById('alarm')).display") != "none"
    assert page.evaluate(at(square(16), "red"))
    another_revision(flight)
    server = WebServer(tmp_path, HttpAddress("127.0.0.1", server.port), Feed())
    server.start()
    page.wait_for(at(square(16), "green"), timeout_s=20)
    page.wait_for(f"!{TEXT}.includes('No connection')")
    assert page.evaluate("window.sameDocument")
    page.open("about:blank")
    server.stop()


@pytest.mark.long
def test_a_page_that_is_refused_changes_asks_for_them_and_listens_again(
    page: Page, tmp_path: Path, flight: SmallFlight
) -> None:
    settings = WebSettings(pages=2, pages_per_address=1)
    server = WebServer(tmp_path, HttpAddress("127.0.0.1", 0), feed := Feed(), settings=settings)
    held = Live(Client(url := server.start()))
    shown_here(page, url, flight)
    another_revision(flight)
    page.wait_for(at(square(16), "green"))
    held.close()
    flight.paint(square(16), BLUE)  # of which no document tells
    revisions = count(flight.manifest.revision + 1)
    until(lambda: shows_when_told(page, feed, next(revisions)), "it listens again")
    page.open("about:blank")
    server.stop()


def shows_when_told(page: Page, feed: Feed, revision: int) -> bool:
    """Whether the page shows blue; it is told of it once more."""
    feed.publish(revision, [(0, square(16))])
    return bool(page.evaluate(at(square(16), "blue")))


@pytest.mark.long
def test_a_map_that_stands_still_is_an_alarm(page: Page, url: str, flight: SmallFlight) -> None:
    shown_here(page, url, flight)
    flight.status(revision=flight.manifest.revision + 5)
    page.wait_for("performance.getEntriesByName(new URL('/status.json', location).href).length > 1")
    assert not page.evaluate(f"{TEXT}.includes('The map is older')")
    later(page, 11)
    page.wait_for(f"{TEXT}.includes('The map is older than what gcs-mosaic has')")
    for _ in range(5):
        another_revision(flight)  # which nobody tells the page
    page.wait_for(at(square(16), "green"), timeout_s=20)
    page.wait_for(f"!{TEXT}.includes('The map is older')", timeout_s=20)


@pytest.mark.long
def test_another_device_gets_in_by_the_link_and_stays_in(
    page: Page, flight: SmallFlight, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(access, "is_loopback", lambda origin: False)
    server = WebServer(flight.root, HttpAddress("127.0.0.1", 0), Feed(), Access(token="abcdefgh23456789"))
    url = server.start()
    shown = [f"{TEXT}.includes('This device may not look yet')", f"{TEXT}.includes('Flying')"]
    flight.write()
    flight.status()
    page.open(url)
    page.wait_for(shown[0])
    page.command("Page.navigate", url=f"{url}?token=abcdefgh23456789")
    page.wait_for(f"document.readyState === 'complete' && {shown[1]} && location.href === '{url}'")
    assert page.evaluate("document.cookie") == ""
    page.open("about:blank")
    page.open(url)
    page.wait_for(shown[1])
    page.command("Network.clearBrowserCookies")
    page.wait_for("fetch('/status.json').then((answer) => answer.status === 401)")
    time.sleep(1.2)  # what was asked before is answered
    later(page, 6)
    page.wait_for(f"{TEXT}.includes('This device may not look any more')", timeout_s=20)
    page.open("about:blank")
    server.stop()


@pytest.mark.long
def test_hostile_names_stay_text(page: Page, url: str, flight: SmallFlight) -> None:
    evil = "<img src=x onerror=window.evil=1>"
    flight.write()
    flight.status(flight=evil, last_frame=None, watch=None, state="flying")
    page.open(url)
    page.wait_for(f"{TEXT}.includes('Flying')")
    assert not page.evaluate("window.evil")
