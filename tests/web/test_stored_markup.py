"""Stored markup in a real browser: whatever names and notes contain is shown as text, in every panel and every export."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import quote
from xml.etree import ElementTree

import pytest

from gcs_mosaic.messages import LinkReport, SourceReport
from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.render.tile_grid import Tile
from gcs_mosaic.stitch.camera.geometry import Camera, Pose
from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.manifest import IslandEntry
from gcs_mosaic.store.records import EventState, FlightRecord, NoticeRecord
from gcs_mosaic.store.status import AircraftStatus, LastFrame
from gcs_mosaic.web.address import HttpAddress
from gcs_mosaic.web.server import WebServer
from tests.factories import frame, trigger_event
from tests.web.browser import CHROMIUM, Page, open_browser
from tests.web.small_flight import MIDDLE, RED, SmallFlight
from tests.web.test_notes_api import Writer
from tests.web.test_people_on_the_page import PANELS, UNFOLD

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")


@pytest.fixture(autouse=True)
def harm_fits_no_description(complaints: list[str]) -> Iterator[None]:
    """What is stored here is more than any answer of ours is described to be."""
    yield
    complaints.clear()


HARM = """<img src=x onerror="window.struck=1"><script>window.struck=2</script>'"--></title>]]>&lt;"""
SHORT = "<img src=x onerror=window.struck=3>"  # names have 60 letters
CAMERA = Camera(240, 180, focal=1.3)
STRUCK = "window.struck === undefined && document.querySelectorAll('img[src=x], iframe').length === 0"
EXPORTS = ("/api/v1/finds.kml", "/api/v1/finds.geojson", "/api/v1/finds.csv", "/api/v1/finds.html")


def harmful_flight(root: Path) -> SmallFlight:
    """Every name that a camera, a link or somebody who hands over the folder can choose is markup."""
    flight = SmallFlight(root)
    names = [f"{number}{HARM.replace('/', chr(0x2215))}.jpg" for number in range(3)]
    with Ledger(root / LEDGER_NAME) as ledger:
        ledger.begin_flight(FlightRecord(name=HARM, started_utc=1.0))
        ledger.record_island(0)
        for number, name in enumerate(names):
            pose = Pose(200.0 * number, 100.0)
            ledger.record_frame(frame(name, modified=1.7e9))
            ledger.record_size(name, CAMERA.width, CAMERA.height, 0.2)
            ledger.record_painted(RenderItem(name=name, order=0, island=0, pose=pose, camera=CAMERA, level=16))
            flight.place(name, pose.x, pose.y)
        for number, found in enumerate([names[0], None, names[2]]):
            event = ledger.record_event(trigger_event(number, 100.0 + 2 * number))
            ledger.settle_event(event, EventState.MATCHED if found else EventState.MISSING, frame=found)
    flight.paint(Tile(16, MIDDLE, MIDDLE), RED)
    flight.islands = [IslandEntry(id=0, bounds=(-256, -256, 1024, 768), minzoom=13, maxzoom=16, frames=3)]
    flight.write()
    flight.status(
        flight=HARM,
        mavlink=(LinkReport(address=HARM, state="heard", last_heard_utc=1.0),),
        watch=SourceReport(kind="folder", name=HARM, state="watching"),
        last_frame=LastFrame(name=names[0], outcome=HARM, island=0, utc=1.0, seconds_to_tile=0.5),
        notices=tuple(
            NoticeRecord(utc=1.0, source=HARM, level=level, text=HARM) for level in ("info", "warning", "error")
        ),
        aircraft=(AircraftStatus(system=1), AircraftStatus(system=2)),
    )
    return flight


def write_notes(url: str) -> None:
    writer = Writer(url)
    place = {"island": 0, "x": 20.0, "y": 30.0}
    words = {"label": HARM, "kind": SHORT, "note": HARM * 3, "who": SHORT}
    written = [
        ("/finds", {**place, **words}),
        ("/pins", {**place, "label": SHORT, "who": SHORT, "longitude": 11.5, "latitude": 48.1, "sigma_m": 3}),
        ("/pins", {**place, "x": 400.0, "label": SHORT, "who": SHORT, "longitude": 11.501, "latitude": 48.1}),
        ("/scale", {"island": 0, "from": [0, 0], "to": [200, 0], "metres": 20, "who": SHORT}),
        ("/reviews", {"island": 0, "box": [0, 0, 200, 200], "level": 16, "seconds": 9, "who": SHORT}),
    ]
    for path, told in written:
        status, said = writer.send("POST", path, told)
        assert status < 300, (path, said)


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    with open_browser(tmp_path_factory.mktemp("profile")) as opened:
        yield opened


@pytest.fixture
def url(tmp_path: Path, page: Page) -> Iterator[str]:
    flight = harmful_flight(tmp_path)
    server = WebServer(flight.root, HttpAddress("127.0.0.1", 0))
    address = server.start()
    write_notes(address)
    yield address
    page.open("about:blank")
    server.stop()


@pytest.mark.long
def test_no_panel_runs_what_is_stored(page: Page, url: str) -> None:
    page.resize(1280, 800)
    page.open(url)
    page.wait_for("document.querySelectorAll('.leaflet-tile-loaded img').length > 0")
    page.wait_for("document.querySelectorAll('.find').length > 0")
    for panel in PANELS:
        page.evaluate(f"document.getElementById('open-{panel}').click()")
        page.wait_for(f"!document.getElementById('{panel}').hidden")
        page.evaluate(UNFOLD)
        page.evaluate(f"document.querySelectorAll('#{panel} button[aria-pressed=false]').forEach((one) => one.click())")
        page.evaluate(
            "document.querySelectorAll('.leaflet-marker-icon, .leaflet-interactive, [title]')"
            ".forEach((one) => one.dispatchEvent(new MouseEvent('mouseover', { bubbles: true })))"
        )
        assert page.evaluate(STRUCK), panel
    assert SHORT in page.evaluate("document.body.textContent")
    page.evaluate("document.querySelector('#finds-list button')?.click()")
    assert page.evaluate(STRUCK)
    assert not [text for text in page.complaints if "Content Security Policy" in text or "struck" in text]


@pytest.mark.long
def test_originals_show_a_name_as_text(page: Page, url: str) -> None:
    page.open(url)
    page.wait_for("document.querySelectorAll('.leaflet-tile-loaded img').length > 0")
    page.evaluate("document.getElementById('map').focus()")
    for kind in ("mousePressed", "mouseReleased"):
        page.command("Input.dispatchMouseEvent", type=kind, x=600, y=400, button="left", clickCount=1)
    page.evaluate("new Promise((done) => setTimeout(done, 300))")
    assert page.evaluate(STRUCK)


@pytest.mark.parametrize("path", EXPORTS)
def test_no_export_runs_what_is_stored(page: Page, url: str, path: str, tmp_path: Path) -> None:
    """Opened in the browser as it is served, and as a file somebody has sent."""
    answer, data = Writer(url).ask(path)
    assert answer.status == 200
    kept = tmp_path / path.rpartition("/")[2]
    kept.write_bytes(data)
    if path.endswith(".kml"):
        assert [one.text for one in ElementTree.fromstring(data).iter() if one.tag.endswith("}script")] == []
        return
    if path.endswith((".csv", ".geojson")):
        assert "html" not in answer.headers["Content-Type"]
        return
    for place in (url.rstrip("/") + path, kept.as_uri()):
        page.open(place)
        assert page.evaluate("window.struck === undefined && document.scripts.length === 0"), place
        assert page.evaluate("document.querySelectorAll('img[src=x]').length === 0"), place
        assert "<script>" in page.evaluate("document.body.textContent")


def test_what_other_programs_read_of_it_stays_well_formed(url: str) -> None:
    told = json.loads(Writer(url).ask("/api/v1/maps")[1])
    seen = 0
    for address in sorted(set(addresses(told))):
        path = "/" + address.split("/", 3)[3] if address.startswith("http") else address
        answer, data = Writer(url).ask(quote(path, safe="/?&=%:{}"))
        if answer.status == 200 and "xml" in answer.headers["Content-Type"]:
            assert not [one for one in ElementTree.fromstring(data).iter() if str(one.tag).lower().endswith("}script")]
            seen += 1
    assert seen > 0


def addresses(told: object) -> Iterator[str]:
    """All texts of a document that look like an address without parts to be filled in."""
    if isinstance(told, dict):
        for value in told.values():
            yield from addresses(value)
    elif isinstance(told, list):
        for value in told:
            yield from addresses(value)
    elif isinstance(told, str) and "/maps/" in told and "{" not in told and " " not in told:
        yield told
