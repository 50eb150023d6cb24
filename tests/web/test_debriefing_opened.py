"""The file for the debriefing tells what was looked at, and with which probability somebody would have been seen, by time; it is
opened from a disk in a real browser, with nobody to ask."""

from __future__ import annotations

import re
import sqlite3
import time
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from gcs_mosaic.detection import measured_frames
from gcs_mosaic.export.debriefing import export_debriefing
from gcs_mosaic.notes.search.reviews import ReviewedView, Reviews
from gcs_mosaic.notes.search.seen_ground import seen_cells
from gcs_mosaic.notes.storage.book import NotesBook
from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.views.flight_view import FlightView
from tests.notes.written_pins import write_pins
from tests.web.browser import CHROMIUM, Page
from tests.web.seen_flight import CAMERA, seen_flight
from tests.web.small_flight import SmallFlight

FINEST = 16
LOOKED = (-256.0, -256.0, 256.0, 256.0)
NOISE = np.random.default_rng(1).normal(0, 3, (CAMERA.height, CAMERA.width, 1))
MEADOW = np.asarray(np.clip(np.array([70, 130, 110]) + NOISE, 0, 255), np.uint8)
BY_TIME = re.compile(r"<tr><td>([^<]*)</td><td>(\d+)</td><td>(\d+)%</td><td>(\d*)%?</td></tr>")


def looked(root: Path, level: int, who: str) -> None:
    """Somebody looks at a part."""
    stamps = seen_cells(FlightView(root).table(), 0, LOOKED)
    with closing(NotesBook(root)) as book:
        reviews = Reviews(book)
        reviews.report(ReviewedView(island=0, box=LOOKED, level=level, seconds=3.0, who=who, stamps=stamps))
        reviews.flush()


@pytest.fixture
def searched(flight: SmallFlight, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A flight whose pictures show a meadow of 5 cm a pixel, of which Kim has looked at a part."""
    monkeypatch.setattr(measured_frames, "displayed", lambda *_: MEADOW)
    metres = 0.05
    corners = ((0, 0), (700, 0), (0, 400), (700, 400))
    write_pins(flight.root, [(x, y, 8.5 + metres * x / 75_600, 47.3 - metres * y / 111_200) for x, y in corners])
    looked(flight.root, FINEST, "Kim")
    return flight.root


def test_it_tells_what_was_looked_at_and_by_whom(searched: Path) -> None:
    export_debriefing(searched, searched / "d.html")
    text = (searched / "d.html").read_text()
    told = re.search(r"looked at, at full sharpness</th><td>(\d+)% \(Kim (\d+)%\)", text)
    assert told is not None
    ground = seen_cells(FlightView(searched).table(), 0, (-1000.0, -1000.0, 2000.0, 2000.0))
    part = seen_cells(FlightView(searched).table(), 0, LOOKED)
    assert {int(told[1]), int(told[2])} == {round(100 * len(part) / len(ground))}
    assert "As it was looked at" in text


def test_who_was_too_far_away_has_looked_at_nothing(flight: SmallFlight) -> None:
    looked(flight.root, FINEST - 3, "Kim")
    export_debriefing(flight.root, flight.root / "d.html")
    assert "looked at, at full sharpness</th><td>0%</td>" in (flight.root / "d.html").read_text()


def test_the_probability_grows_with_what_was_seen_and_ends_at_that_of_all(searched: Path) -> None:
    export_debriefing(searched, searched / "d.html")
    text = (searched / "d.html").read_text()
    rows = BY_TIME.findall(text)
    assert [int(pictures) for _, pictures, *_ in rows] == sorted({int(pictures) for _, pictures, *_ in rows})
    assert int(rows[-1][1]) == 19
    seen, chance = ([int(row[at]) for row in rows] for at in (2, 3))
    assert seen == sorted(seen)
    assert chance == sorted(chance), "no picture takes anything back: one person, one kind of ground"
    assert 0 < chance[0] < chance[-1] <= seen[-1]
    assert f"<td>{chance[-1]}% in what was flown, gaps included" in text


def test_why_nothing_is_told_of_the_probability_is_said(flight: SmallFlight) -> None:
    export_debriefing(flight.root, flight.root / "d.html")
    text = (flight.root / "d.html").read_text()
    assert "not known: how large the ground is, is not known: set two pins" in text
    hole = (200 - 40) * (150 - 30) / ((4 * 200 + 240) * (3 * 150 + 180))  # what only the missing frame would show
    assert BY_TIME.findall(text)[-1][2:] == (f"{100 * (1 - hole):.0f}", ""), "what was seen is told all the same"


def test_where_all_files_came_at_once_curves_go_over_the_pictures(flight: SmallFlight) -> None:
    """A copied folder: the files' times are those of the copying, all within a second."""
    export_debriefing(flight.root, flight.root / "d.html")
    (first, last) = re.findall(r">(\d+) pictures?</text>", (flight.root / "d.html").read_text())
    assert (first, last) == ("1", "19")


def test_a_flight_of_one_picture_has_its_file(tmp_path: Path) -> None:
    root = seen_flight(tmp_path).root
    with closing(sqlite3.connect(root / LEDGER_NAME)) as ledger:
        ledger.execute("DELETE FROM painted WHERE frame != (SELECT min(frame) FROM painted)")
        ledger.commit()
    export_debriefing(root, root / "d.html")
    text = (root / "d.html").read_text()
    assert BY_TIME.findall(text)[-1][1:] == ("1", "100", "")
    assert 'class="curves"' not in text


@pytest.mark.long
@pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")
def test_opened_from_a_disk_it_shows_all_of_it_and_asks_nobody(searched: Path, page: Page) -> None:
    export_debriefing(searched, searched / "d.html")
    page.requests.clear()
    page.complaints.clear()
    page.open(f"file://{searched / 'd.html'}")
    assert {url.split(":")[0] for url in page.requests} <= {"file", "data"}
    assert page.complaints == []
    kinds = page.evaluate("[...document.querySelectorAll('.layered input')].map((one) => one.className)")
    assert kinds == ["way", "gaps", "probability", "unreviewed", "marks"]
    assert page.evaluate("[...document.images].every((one) => one.naturalWidth > 0)")
    for kind in kinds:
        shown = f"getComputedStyle(document.querySelector('g.{kind}')).display !== 'none'"
        before = page.evaluate(shown)
        page.evaluate(f"document.querySelector('input.{kind}').click()")
        assert page.evaluate(shown) is not before, kind
    for curve in page.evaluate("[...document.querySelectorAll('.curves polyline')].map((one) => one.getBBox().width)"):
        assert curve > 300
    page.open("about:blank")


@pytest.mark.long
@pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")
def test_the_page_measures_the_pictures_before_it_saves_the_file(searched: Path, page: Page, url: str) -> None:
    told = "document.getElementById('finds-debriefing-said').textContent"
    page.open(url)
    page.wait_for("document.querySelectorAll('.leaflet-tile-loaded img').length > 0")
    page.evaluate(
        "void (() => { const made = URL.createObjectURL; URL.createObjectURL = (data) => {"
        " data.text().then((text) => { window.saved = text; }); return made(data); }; })()"
    )
    page.evaluate("document.getElementById('phase-report').click()")
    page.evaluate("document.getElementById('finds-debriefing').click()")
    page.wait_for(f"{told}.includes('of 19 pictures are measured')")
    page.wait_for("!!window.saved", timeout_s=60)
    saved = page.evaluate("window.saved")
    assert BY_TIME.findall(saved)[-1][3] != ""
    assert "Kim" in saved
    page.wait_for(f"{told}.startsWith('Saved.')")


@pytest.mark.long
@pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")
def test_who_presses_again_has_the_file_at_once(
    searched: Path, page: Page, url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def slow(*_: object) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
        time.sleep(5)
        return MEADOW

    monkeypatch.setattr(measured_frames, "displayed", slow)
    page.open(url)
    page.wait_for("document.querySelectorAll('.leaflet-tile-loaded img').length > 0")
    page.evaluate("document.getElementById('phase-report').click()")
    page.evaluate("document.getElementById('finds-debriefing').click()")
    page.wait_for("document.getElementById('finds-debriefing-said').textContent.includes('Press again')")
    page.evaluate("document.getElementById('finds-debriefing').click()")
    page.wait_for("document.getElementById('finds-debriefing-said').textContent.startsWith('Saved.')", timeout_s=40)
