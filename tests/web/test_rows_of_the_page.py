"""What a search of the page for defects found, row by row: each has a test in a real browser.

| row | what was wrong | held by |
|---|---|---|
| 1 | answers from an old table of frames | `test_fresh_answers`, `tests/views/test_flight_view` |
| 2 | the file's time for that of the capture | `tests/views/test_taken`, `test_original_frames` |
| 3 | a phone without room for the map | `test_calm_layout::test_the_map_has_most_of_the_screen` |
| 4 | chips of aircraft over tools and panels | `test_calm_layout::test_nothing_lies_over_anything_else` |
| 5 | a click beside the map opens a black screen | `test_fresh_answers::test_where_nobody_looked_the_map_stays_in_sight` |
| 6 | one figure is printed over another | `test_calm_layout::test_nothing_lies_over_anything_else` |
| 7 | no mark where a find is being set | `test_calm_layout::test_a_find_can_be_placed_on_a_phone` |
| 8 | one lost script leaves a blank page | `test_bundle::test_a_script_that_is_lost_on_the_way_leaves_a_sentence_and_a_way_on` |
| 9 | islands that are not shown are not told | `test_calm_layout::test_what_is_not_in_view_is_always_told` |
| 10 | one fact told three times, and yellow when it is over | here |
| 11 | a tool stays armed, "Escape" on a phone | `test_people_on_the_page::test_lengths_a_scale_and_a_person_s_size` |
| 12 | no answers for the whole area, review of an idle page | `test_people_on_the_page::test_what_was_looked_at_closely_...` |
| 13 | exports without an anchor are empty without a word | here; the files' own words: `tests/notes/finds` |
| 14 | times without a date, in three formats; triggers of folders | here |
| 15 | two yellow frames while playing; no time | here |
| 16 | keys in another order than the buttons | `test_people_on_the_page::test_keys_do_what_the_sheet_says` |
| 17 | the terminal | `tests/app/status`, `tests/cli` |
| 18 | edges of tiles beyond the finest level and in layers; endless 404s | here |
"""

from __future__ import annotations

import re
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from gcs_mosaic.messages import LinkReport, SourceReport
from gcs_mosaic.render.tile_grid import Tile
from gcs_mosaic.store.records import Accounts, NoticeRecord
from gcs_mosaic.store.status import Behind, Condition
from gcs_mosaic.store.told_documents import FrameAccount
from gcs_mosaic.web.feed import Feed
from tests.notes.written_pins import write_pins
from tests.sure import sure
from tests.web.browser import CHROMIUM, Page
from tests.web.small_flight import MIDDLE, RED, SmallFlight
from tests.web.test_fresh_answers import fill_the_hole
from tests.web.test_notes_api import Writer

pytestmark = [pytest.mark.long, pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")]

SHOWN = "document.querySelectorAll('.leaflet-tile-loaded img').length > 0"
SETTLED = "!document.querySelector('.leaflet-zoom-anim, .leaflet-pan-anim, .on-its-way, .leaflet-tile:not(.leaflet-tile-loaded)')"
BEHIND = "The map is 16 frames, 48 s behind: the newest are stitched first"
SLIDE = """((value) => {
  const slider = document.getElementById("flight-slider");
  slider.value = value;
  slider.dispatchEvent(new Event("input"));
})"""
# What is in sight: not what is told to screen readers alone.
SIGHT = "document.getElementById('strip').innerText + document.querySelector('main').innerText"
DATED = re.compile(r"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d")


def test_row_10_one_fact_is_told_once_and_goes_when_it_is_over(page: Page, url: str, flight: SmallFlight) -> None:
    """It stood in the line of state, in a banner and among the notices, all in sight; "behind" stayed yellow."""
    now = time.time()
    notice = NoticeRecord(utc=now - 2, source="map", level="warning", text=BEHIND)
    condition = Condition(key="behind", level="warning", text=BEHIND, since_utc=now - 2)
    flight.status(conditions=(condition,), notices=(notice,))
    page.open(url)
    page.wait_for("document.getElementById('state').className === 'warn'")
    assert page.evaluate(SIGHT).count("48 s behind") == 1
    over = NoticeRecord(utc=now, source="map", level="info", text="the map has caught up")
    flight.status(notices=(notice, over))
    page.wait_for("document.getElementById('state').className === 'good'")
    assert "behind" not in page.evaluate(SIGHT)
    assert page.evaluate("document.getElementById('chip').hidden")


def test_a_flight_that_ends_is_not_asked_for_its_link(page: Page, url: str, flight: SmallFlight) -> None:
    """It was said to be silent, in yellow, when it had been closed and the last frames were worked off."""
    silent = (LinkReport(address="udp:14550", state="silent", last_heard_utc=time.time() - 30),)
    flight.status(mavlink=silent)
    page.open(url)
    page.wait_for("document.getElementById('state').innerText.includes('MAVLink silent')")
    flight.status(state="settling", mavlink=silent, behind=Behind(frames=16, seconds=48.0))
    page.wait_for("document.getElementById('state').innerText.includes('Finishing')")
    assert "16 frames, 48 s behind" in page.evaluate("document.getElementById('state').innerText")


def test_a_flight_that_goes_on_has_frames(page: Page, url: str, flight: SmallFlight) -> None:
    """Started again after a crash it was said to have none, beside its map."""
    flight.status(state="listening")
    page.open(url)
    page.wait_for("document.getElementById('state').innerText.includes('no new frame yet')")
    flight.status(state="listening", accounts=Accounts())
    page.wait_for("document.getElementById('state').innerText.includes('no frame yet')")


def test_row_13_finds_without_an_anchor_are_said_to_be_nowhere_for_others(
    page: Page, url: str, flight: SmallFlight
) -> None:
    earth = "document.getElementById('finds-earth')"
    page.open(url)
    page.evaluate("document.getElementById('phase-report').click()")
    page.wait_for("document.querySelector('#finds a[href$=\"finds.kml\"]').getClientRects().length > 0")
    assert page.evaluate(f"{earth}.hidden"), "there is no find that could be missed"
    Writer(url).send("POST", "/finds", {"island": 0, "x": 20, "y": 30, "label": "tent", "who": "Kim"})
    page.wait_for(f"{earth}.getClientRects().length > 0")
    assert page.evaluate(f"{earth}.innerText").startswith("Without an anchor GeoJSON and KML hold no coordinates")
    write_pins(flight.root, [(x, y, 8.5 + 1e-6 * x, -1e-6 * y) for x, y in ((0, 0), (700, 0), (700, 400))])
    page.open(url)
    page.evaluate("document.getElementById('phase-report').click()")
    page.wait_for("document.getElementById('finds-list').innerText.includes('tent')")
    assert page.evaluate(f"{earth}.hidden")


def test_row_14_times_have_a_date_and_one_format(page: Page, url: str, flight: SmallFlight) -> None:
    """It said "Saved flight 09:12:07", times in three formats, and "Triggers matched 0" of a folder."""
    page.open(url)
    page.wait_for("document.querySelector('#state b').textContent === 'Saved flight'")
    assert DATED.search(page.evaluate("document.querySelector('#state span').textContent"))
    flight.status(
        state="stopped",
        mavlink=(),
        accounts=Accounts(frames=FrameAccount(placed=19)),
        watch=SourceReport(kind="folder", name="frames", state="watching"),
    )
    page.open(url)
    page.wait_for("document.querySelector('#state b').textContent === 'Flight ended'")
    page.evaluate("document.getElementById('state').click()")
    page.evaluate("document.getElementById('phase-fly').click()")
    page.wait_for("Number(document.getElementById('flight-slider').max) > 5")
    page.evaluate(
        "(s => { s.value = '5'; s.dispatchEvent(new Event('input')); })(document.getElementById('flight-slider'))"
    )
    page.wait_for(r"/\d\d:\d\d/.test(document.getElementById('flight-time').textContent)")
    shown = page.evaluate("document.body.innerText")
    assert len(re.findall(r"\d\d:\d\d", DATED.sub("", shown))) == 0
    assert len(DATED.findall(shown)) >= 3  # state, notice, frame
    assert "riggers matched" not in shown


def test_row_15_while_playing_one_frame_is_marked_and_told_with_its_time(page: Page, url: str) -> None:
    """The newest frame and the one that it was played to were marked alike; only a name was told."""
    marked = "document.querySelectorAll('#map .leaflet-overlay-pane svg path:not([stroke-dasharray], .gap)').length"
    page.open(url)
    page.wait_for(f"{SHOWN} && {marked} > 0")
    page.evaluate("document.getElementById('phase-fly').click()")
    page.evaluate(
        "(s => { s.value = '5'; s.dispatchEvent(new Event('input')); })(document.getElementById('flight-slider'))"
    )
    page.wait_for(f"{marked} === 0")  # the other is drawn on a canvas
    page.wait_for("document.getElementById('flight-time').textContent.includes('After 5 of 19 frames')")
    page.wait_for(
        r"/\.jpg, came \d{4}-\d\d-\d\d \d\d:\d\d:\d\d$/.test(document.getElementById('flight-time').textContent)"
    )
    page.evaluate(
        "(s => { s.value = s.max; s.dispatchEvent(new Event('input')); })(document.getElementById('flight-slider'))"
    )
    page.wait_for(f"{marked} > 0")


def test_row_18_a_saved_flight_does_not_ask_for_what_is_not_there(page: Page, url: str, flight: SmallFlight) -> None:
    """status.json and placements.jsonl were asked for each second, and were not there."""
    page.open(url)
    page.wait_for("document.querySelector('#state b').textContent === 'Saved flight'")
    page.evaluate("new Promise((done) => setTimeout(done, 1000))")
    asked = len(page.requests)
    page.evaluate("new Promise((done) => setTimeout(done, 5000))")
    assert len(page.requests) > asked, "it asks whether the server is there"
    later = [request for request in page.requests[asked:] if "status.json" in request or "placements" in request]
    assert later == []


def red_ground(page: Page, path: Path) -> np.ndarray[Any, np.dtype[np.int_]]:
    """(rows, columns, 3) of the middle of the page when its ground is red and nothing moves: two pictures that are the same."""
    before = np.zeros(0, int)
    end = time.monotonic() + 30
    while time.monotonic() < end:
        page.wait_for(SETTLED)
        page.screenshot(path)
        middle = sure(cv2.imread(str(path)))[250:650, 300:1000].astype(int)
        _, green, red = np.median(middle, axis=(0, 1))
        if red > green + 40 and np.array_equal(before, middle):
            return middle
        before = middle
        time.sleep(0.3)
    raise AssertionError("the ground never stands still in red")


def test_row_18_no_edge_of_a_tile_is_seen(page: Page, url: str, flight: SmallFlight, tmp_path: Path) -> None:
    """Beyond the finest level, and in layers, a browser left hairlines between tiles, or what overlaps showed twice."""
    for column, row in np.ndindex(7, 7):
        flight.paint(Tile(16, MIDDLE - 2 + column, MIDDLE - 2 + row), RED)
    fill_the_hole(flight, Feed())
    flight.paint(Tile(16, MIDDLE + 1, MIDDLE), RED)
    page.open(url)
    page.wait_for("document.getElementById('layer').options.length > 1")
    page.evaluate(
        "document.querySelectorAll('.leaflet-overlay-pane').forEach((one) => { one.style.display = 'none'; })"
    )
    for layer in ("", "resolution"):
        select = f"(s => {{ s.value = '{layer}'; s.dispatchEvent(new Event('change')); }})"
        page.evaluate(f"{select}(document.getElementById('layer'))")
        page.evaluate("document.getElementById('all').click()")
        time.sleep(0.5)  # its animation: zoomed in meanwhile, it would end somewhere else
        page.wait_for(SETTLED)
        for _ in range(5):  # from a quarter of a level to beyond the finest
            page.evaluate("document.querySelector('.leaflet-control-zoom-in').click()")
            time.sleep(0.5)  # its animation
            middle = red_ground(page, tmp_path / "seen.png")
            usual = np.median(middle, axis=(0, 1))
            assert (np.abs(middle - usual).max(axis=2) > 6).mean() < 1e-4
