"""What people add on the page, in a real browser: finds, a scale, lengths, reviews, pins; islands and the flight played again."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

import axe_core_python
import pytest

from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.manifest import IslandEntry
from gcs_mosaic.store.records import EventState
from gcs_mosaic.web.address import HttpAddress
from gcs_mosaic.web.server import WebServer
from tests.factories import trigger_event
from tests.ports import free_port
from tests.tiers import thorough
from tests.web.browser import CHROMIUM, Page
from tests.web.seen_flight import seen_flight
from tests.web.small_flight import SmallFlight
from tests.web.test_notes_api import Writer

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")
SIZES = [(400, 800), (1024, 768), (1280, 800), (1920, 1080)]
AXE = Path(axe_core_python.__file__).parent / "axe.min.js"
RULES = "{ runOnly: ['wcag2a', 'wcag2aa', 'wcag21a', 'wcag21aa'] }"
VIOLATIONS = f"""axe.run(document, {RULES}).then(({{ violations, passes }}) => {{
  const where = (nodes) => nodes.slice(0, 3).map(({{ html, any }}) => [html, any[0]?.message]);
  const told = violations.map(({{ id, nodes }}) => ({{ id, nodes: where(nodes) }}));
  return passes.length < 10 ? [...told, {{ id: "too little was looked at" }}] : told;
}})"""
SHOWN_TILES = "[...document.querySelectorAll('.leaflet-tile-loaded img')].filter((one) => one.naturalWidth).length"
FLY, SEARCH, REPORT = (
    ["flight", "islands", "layers", "mission"],
    ["reviews", "hints", "trees", "measure"],
    ["finds", "anchors", "elsewhere"],
)
PANELS = [*FLY, *SEARCH, *REPORT, "look", "detection"]
UNFOLD = "document.querySelectorAll('#elsewhere details').forEach((one) => { one.open = true; })"


class Person:
    """Somebody at the page, who clicks and types."""

    def __init__(self, page: Page, url: str, size: tuple[int, int] = (1280, 800)) -> None:
        self.page = page
        page.resize(*size)
        page.open(url)
        page.wait_for("document.querySelectorAll('.leaflet-tile-loaded img').length > 0")

    def press(self, id_: str) -> None:
        """Of a panel's tab that is not to be seen the button of its phase first, which is all where it is the only one."""
        button = f"document.getElementById('{id_}')"
        if phase := self.page.evaluate(f"({button}.getClientRects().length === 0 && {button}.dataset.phase) || ''"):
            self.page.evaluate(f"document.getElementById('phase-{phase}').click()")
            if not self.page.evaluate(f"document.getElementById('{id_.removeprefix('open-')}').hidden"):
                return
        assert self.page.evaluate(f"document.getElementById('{id_}').getClientRects().length") > 0, id_
        self.page.evaluate(f"document.getElementById('{id_}').click()")

    def click(self, x: float, y: float) -> None:
        for kind in ("mousePressed", "mouseReleased"):
            self.page.command("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)

    def type(self, form: str, **texts: str) -> None:
        for name, text in texts.items():
            field = f"document.getElementById('{form}').elements.{name}"
            self.page.evaluate(f"{field}.value = {json.dumps(text)}")
        self.page.evaluate(f"document.getElementById('{form}').requestSubmit()")

    def text(self, id_: str) -> str:
        return str(self.page.evaluate(f"document.getElementById('{id_}').innerText"))

    def sees(self, id_: str, text: str) -> None:
        self.page.wait_for(f"document.getElementById('{id_}').innerText.includes({json.dumps(text)})")


@pytest.mark.long
def test_a_find_is_marked_edited_deleted_and_brought_back(page: Page, url: str) -> None:
    someone = Person(page, url)
    someone.press("open-finds")
    someone.press("finds-mark")
    someone.sees("hint", "Click where the find is.")
    someone.click(500, 400)
    page.wait_for("!document.getElementById('finds-form').hidden")
    someone.type("finds-form", label="<b>Blue</b> jacket", kind="clothing", note="by the creek")
    someone.sees("finds-list", "<b>Blue</b> jacket")  # as text
    assert someone.text("open-finds") == "Finds: 1"
    middle = "(({x, y, width}) => [x + width / 2, y + width / 2])"
    marker = page.evaluate(f"{middle}(document.querySelector('.find').getBoundingClientRect())")
    assert marker == pytest.approx([500, 400], abs=2)
    page.evaluate("[...document.querySelectorAll('#finds-list button')].find((b) => b.textContent === 'Edit').click()")
    someone.type("finds-form", label="Red jacket")
    someone.sees("finds-list", "Red jacket")
    page.evaluate(
        "[...document.querySelectorAll('#finds-list button')].find((b) => b.textContent === 'Delete').click()"
    )
    page.wait_for("document.querySelectorAll('.find').length === 0")
    page.evaluate("document.querySelector('#finds-undo button').click()")
    someone.sees("finds-list", "Red jacket")
    Writer(url).send("POST", "/finds", {"island": 0, "x": 90, "y": 90, "label": "from another page", "who": "Ann"})
    someone.sees("finds-list", "from another page")
    assert page.complaints == []


@pytest.mark.long
def test_lengths_a_scale_and_a_person_s_size(page: Page, url: str) -> None:
    someone = Person(page, url)
    someone.press("open-measure")
    assert "No scale is known" in someone.text("measure-known")
    someone.press("measure-line")
    for x in (400, 500):
        someone.click(x, 300)
    pixels = float(someone.text("measure-told").split()[0])
    someone.press("measure-scale")
    for x in (400, 500):
        someone.click(x, 300)
    someone.type("measure-metres", metres="50")
    someone.sees("measure-known", f"{5000 / pixels:.3g}"[:3])
    someone.press("measure-line")
    for x in (400, 500):
        someone.click(x, 300)
    someone.sees("measure-told", "50 m")
    assert someone.text("scale-bar").endswith(" m")
    someone.press("measure-person")
    silhouette = page.evaluate("document.getElementById('person').getBoundingClientRect().height")
    assert silhouette == pytest.approx(1.75 * 100 / 50, abs=0.6)  # 100 px on the screen were 50 m
    assert page.complaints == []


@pytest.mark.long
def test_what_was_looked_at_closely_is_reviewed_and_the_rest_shaded(page: Page, url: str) -> None:
    """By somebody: a page that stands there and is not touched reviews nothing, nor does who reads a panel."""
    someone = Person(page, url)
    someone.press("open-reviews")
    someone.press("reviews-show")
    someone.sees("reviews-told", "0 % of the ground")
    for _ in range(8):
        page.evaluate("document.querySelector('.leaflet-control-zoom-in').click()")
    time.sleep(5.0)  # two reports
    assert someone.text("reviews-told") == "0 % of the ground of this part was reviewed."
    page.command("Input.dispatchMouseEvent", type="mouseMoved", x=400, y=300)
    time.sleep(4.0)
    assert someone.text("reviews-told") == "0 % of the ground of this part was reviewed."
    someone.press("side-close")
    page.command("Input.dispatchMouseEvent", type="mouseMoved", x=402, y=300)
    page.wait_for("/^[1-9]/.test(document.getElementById('reviews-told').textContent)")
    someone.press("open-reviews")
    page.wait_for("/^[1-9][0-9]? % of the ground of this part/.test(document.getElementById('reviews-told').innerText)")
    reviewers = Writer(url).get("/reviews?island=0&left=0&top=0&right=9&bottom=9&level=0")["reviewers"]
    assert [one["who"] for one in reviewers] == ["operator"]


@pytest.mark.long
def test_pins_lay_the_map_and_the_cursor_tells_its_coordinate(page: Page, url: str) -> None:
    someone = Person(page, url)
    someone.press("open-anchors")
    for x, y, coordinate in (
        (300, 300, "44.50000, 7.00000"),
        (700, 300, "44.49787, 7.00000"),
        (300, 600, "44.50000, 6.99776"),
    ):
        someone.press("anchors-set")
        someone.click(x, y)
        someone.type("anchors-form", coordinate=coordinate)
        page.wait_for("document.getElementById('anchors-form').hidden")
    someone.sees("anchors-told", "Laid by 3 pins that fit")
    someone.press("open-look")
    someone.press("turn-north-up")
    north = "parseFloat(getComputedStyle(document.getElementById('pane')).getPropertyValue('--turn'))"
    assert page.evaluate(north) == pytest.approx(90.0, abs=1.0)
    someone.press("turn-none")
    someone.press("open-anchors")
    page.command("Input.dispatchMouseEvent", type="mouseMoved", x=300, y=300)
    someone.sees("coordinate", "44.5")
    someone.press("anchors-set")
    someone.click(500, 400)
    someone.type("anchors-form", coordinate="somewhere")
    someone.sees("anchors-said", "is no coordinate that is understood")
    assert page.complaints == []


@pytest.mark.long
def test_the_addresses_for_other_maps_can_be_pasted_and_scanned(page: Page, url: str) -> None:
    someone = Person(page, url)
    someone.press("open-elsewhere")
    someone.sees("elsewhere-told", "Nothing is shown on other maps")
    someone.sees("elsewhere-reach", "Start gcs-mosaic with --http 0.0.0.0:8470")
    writer = Writer(url)
    for x, y, coordinate in ((0, 0, "44.5, 7.0"), (400, 0, "44.5, 7.003"), (0, 300, "44.4984, 7.0")):
        writer.send("POST", "/pins", {"island": 0, "x": x, "y": y, "coordinate": coordinate, "who": "Ann"})
    someone.sees("elsewhere-told", "Shown on other maps, ±")
    stations = "[...document.querySelectorAll('#elsewhere details')]"
    page.evaluate(f"{stations}[0].querySelector('summary').click()")
    page.wait_for(f"{stations}[0].open && {stations}[0].innerText.includes('It refuses this address')")
    address = page.evaluate(f"{stations}[0].querySelector('input').value")
    assert address.startswith(f"{url}maps/small-")
    filled = address.replace("{z}", "0").replace("{x}", "0").replace("{y}", "0")
    assert page.evaluate(f"fetch('{filled}').then((answer) => answer.status)") == 200
    page.evaluate(f"{stations}[0].querySelectorAll('button')[0].click()")
    page.wait_for(f"{stations}[0].innerText.includes('opied') || {stations}[0].innerText.includes('by hand')")
    page.evaluate(f"{stations}[2].open = true; {stations}[2].querySelectorAll('button')[1].click()")
    page.wait_for(f"{stations}[2].querySelector('img').naturalWidth > 100")
    links = page.evaluate(f"[...{stations}[2].querySelectorAll('a')].map((one) => one.href)")
    assert links[0].startswith("tak://com.atakmap.app/import?url=http%3A%2F%2F")
    assert page.complaints == []


@pytest.mark.long
def test_islands_stand_side_by_side_and_the_flight_is_played_again(page: Page, url: str, flight: SmallFlight) -> None:
    flight.islands.append(IslandEntry(id=3, bounds=(0, 0, 512, 512), minzoom=14, maxzoom=16, frames=1))
    flight.write()
    someone = Person(page, url)
    someone.press("open-islands")
    someone.sees("islands-list", "Island 3: 1 frame")
    page.evaluate("document.querySelector('[data-island=\"3\"]').click()")
    page.wait_for("document.querySelector('[data-island=\"3\"]').ariaPressed === 'true'")
    page.evaluate("document.querySelector('[data-island=\"0\"]').click()")
    someone.press("open-flight")
    someone.press("flight-path")
    page.evaluate(
        "((s) => { s.value = 7; s.dispatchEvent(new Event('input')) })(document.getElementById('flight-slider'))"
    )
    someone.sees("flight-time", "After 7 of 19 frames: 12.jpg")
    page.wait_for("document.querySelectorAll('canvas.veil').length === 1")
    page.evaluate("document.getElementById('side-close').click()")
    page.wait_for("document.querySelectorAll('canvas.veil').length === 0")
    assert page.complaints == []


@pytest.mark.long
@pytest.mark.parametrize("size", [*SIZES[:2], *map(thorough, SIZES[2:])], ids=str)
def test_everything_can_be_reached_with_a_finger_and_the_map_stays_large(
    page: Page, url: str, size: tuple[int, int]
) -> None:
    someone = Person(page, url, size)
    share = page.evaluate(
        "(({width, height}) => width * height / ((innerWidth) * document.querySelector('main').offsetHeight))"
        "(document.getElementById('map').getBoundingClientRect())"
    )
    assert share >= 0.7
    for panel in PANELS:
        someone.press(f"open-{panel}")
        page.evaluate(UNFOLD)
        small: list[Any] = page.evaluate(
            "[...document.querySelectorAll('button, select, input, textarea, #side a, summary')].filter((one) => {"
            " const { width, height } = one.getBoundingClientRect();"
            " return width && Math.min(width, height) < 43.5 && one.type !== 'range'; }).map((one) => one.outerHTML)"
        )
        assert small == []
        wide = page.evaluate("document.documentElement.scrollWidth > innerWidth")
        assert not wide


@pytest.mark.long
def test_the_page_speaks_german(page: Page, url: str) -> None:
    Person(page, url)
    page.evaluate("localStorage.setItem('gcs-mosaic language', 'de')")
    try:
        someone = Person(page, url)
        assert someone.text("open-finds") == "Funde"
        someone.press("open-measure")
        someone.sees("measure-known", "Von dieser Insel ist kein Maßstab bekannt")
    finally:
        page.evaluate("localStorage.removeItem('gcs-mosaic language')")


@pytest.mark.long
@pytest.mark.parametrize("theme", ["light", thorough("dark"), thorough("night")])
def test_nothing_hinders_who_sees_hears_or_moves_otherwise(page: Page, url: str, theme: str) -> None:
    """WCAG 2.1 AA as far as axe-core can tell, with each panel open, a find and a pin on the map, and the sheet of keys."""
    writer = Writer(url)
    writer.send("POST", "/finds", {"island": 0, "x": 90, "y": 90, "label": "a tent", "who": "Ann"})
    writer.send("POST", "/pins", {"island": 0, "x": 90, "y": 90, "coordinate": "44.5, 7.1", "who": "Ann"})
    someone = Person(page, url)
    page.evaluate(AXE.read_text("utf-8") + "; true")
    someone.press("open-look")
    page.evaluate(f"document.getElementById('look-theme').value = '{theme}'")
    page.evaluate("document.getElementById('look-theme').dispatchEvent(new Event('input'))")
    found: dict[str, Any] = {}
    for panel in [*PANELS, "help"]:
        someone.press(f"open-{panel}")
        page.evaluate(UNFOLD)
        for violation in page.evaluate(VIOLATIONS):
            found[violation["id"]] = violation
    page.evaluate("document.getElementById('help').close()")
    page.evaluate("localStorage.removeItem('gcs-mosaic look')")
    assert found == {}


@pytest.mark.long
def test_keys_do_what_the_sheet_says(page: Page, url: str) -> None:
    someone = Person(page, url, (844, 390))  # where the sheet is longer than the window

    def key(name: str) -> None:
        page.command("Input.dispatchKeyEvent", type="keyDown", key=name, text=name if len(name) == 1 else "")

    key("?")
    page.wait_for("document.getElementById('help').open")
    assert page.evaluate("document.getElementById('help').scrollTop") == 0
    someone.press("help-close")
    told = page.evaluate("document.querySelector('#help-keys dd').textContent").split(", ")
    assert [one[0] for one in told] == list("1234567890")
    for digit, panel in (one.split("\u00a0", 1) for one in told):
        key(digit)
        page.wait_for(f"document.querySelector('section.panel:not([hidden])')?.ariaLabel === {json.dumps(panel)}")
    key("m")
    someone.sees("hint", "Click where the find is.")
    key("Escape")
    page.wait_for("document.getElementById('hint').hidden")
    key("n")
    page.wait_for("document.getElementById('newest').getAttribute('aria-pressed') === 'true'")


HIDDEN = "gcs-mosaic finds hidden"
OPEN = """["help", "originals", "sheet", "hint", "finds-form", "side", "looking"].filter((id) => {
  const one = document.getElementById(id);
  return one.localName === "dialog" ? one.open : one.getClientRects().length > 0;
})"""


@pytest.mark.long
def test_escape_closes_one_thing_the_innermost_first_wherever_the_keyboard_is(page: Page, url: str) -> None:
    someone = Person(page, url)
    someone.press("open-reviews")
    someone.press("looking-begin")
    page.wait_for(f"{OPEN}.join() === 'looking'")
    page.evaluate("document.getElementById('map').focus()")
    page.key(str(1 + PANELS.index("finds")))
    someone.press("finds-mark")
    someone.click(500, 400)
    page.wait_for("!document.getElementById('finds-form').hidden")
    someone.press("finds-mark")
    someone.press("state")
    page.evaluate("document.getElementById('originals').hidden = false")
    page.evaluate("document.getElementById('open-help').click()")
    order = ["help", "originals", "sheet", "hint", "finds-form", "side", "looking"]
    for at in range(len(order)):
        assert page.evaluate(OPEN) == order[at:]
        page.key("Escape")
    assert page.evaluate(OPEN) == []
    assert page.complaints == []


@pytest.mark.long
def test_a_panel_that_a_digit_opened_over_the_map_is_closed_there(page: Page, url: str) -> None:
    Person(page, url)
    page.evaluate("document.getElementById('map').focus()")
    for digit in "1234567890":
        page.key(digit)
        assert page.evaluate(OPEN) == ["side"]
        page.key("Escape")
        assert page.evaluate(OPEN) == []
        assert page.evaluate("document.activeElement.id") == "map"


@pytest.mark.long
def test_many_finds_can_be_hidden_and_a_new_one_shows_them_again(page: Page, url: str) -> None:
    writer = Writer(url)

    def mark(number: int) -> None:
        writer.send(
            "POST", "/finds", {"island": 0, "x": 9.0 * number, "y": 90, "label": f"find {number}", "who": "Ann"}
        )

    markers = "document.querySelectorAll('.find').length"
    for number in range(1, 4):
        mark(number)
    someone = Person(page, url)
    page.wait_for(f"{markers} === 3")
    someone.press("open-finds")
    someone.press("finds-show")
    page.wait_for(f"{markers} === 0")
    someone.sees("finds-hidden", "3 finds hidden")
    someone = Person(page, url)  # it is kept on the device
    page.wait_for("document.querySelectorAll('#finds-list li').length === 3")
    assert page.evaluate(markers) == 0
    someone.sees("finds-hidden", "3 finds hidden")
    page.evaluate(f"localStorage.setItem('{HIDDEN}', JSON.stringify({{ flight: 'another', to: 3 }}))")
    someone = Person(page, url)
    page.wait_for(f"{markers} === 3")  # those of another flight have the same numbers
    someone.press("open-finds")
    someone.press("finds-show")
    page.wait_for(f"{markers} === 0")
    page.evaluate("document.querySelector('#finds-list [data-find]').click()")  # who goes to one sees it
    page.wait_for(f"{markers} === 1")
    someone.sees("finds-hidden", "2 finds hidden")
    mark(4)
    page.wait_for(f"{markers} === 4")
    assert page.evaluate("document.getElementById('finds-hidden').hidden")
    assert page.evaluate("document.getElementById('finds-show').getAttribute('aria-pressed')") == "true"
    assert page.evaluate(f"localStorage.getItem('{HIDDEN}')") is None


@pytest.mark.long
def test_what_was_seen_stays_viewable_without_the_server(page: Page, tmp_path: Path) -> None:
    """Also after a reload; it is told as lost, and is the living map again when the server is back."""
    flight = seen_flight(tmp_path)
    server = WebServer(flight.root, HttpAddress("127.0.0.1", free_port()))
    url = server.start()
    page.keep_nothing(nothing=False)
    try:
        Person(page, url)
        page.wait_for("navigator.serviceWorker.controller !== null")
        someone = Person(page, url)  # by way of the worker now
        page.wait_for("caches.open('gcs-mosaic 1').then((kept) => kept.match('/mosaic.json')).then(Boolean)")
        page.wait_for("!document.querySelector('.on-its-way')")
        server.stop()
        page.open("about:blank")
        page.open(url)
        page.wait_for(f"{SHOWN_TILES} > 0", 20)
        page.wait_for("!document.getElementById('alarm').hidden", 20)
        server = WebServer(flight.root, HttpAddress("127.0.0.1", int(url.rstrip("/").rpartition(":")[2])))
        server.start()
        page.wait_for("document.getElementById('alarm').hidden", 20)
        assert someone.text("open-finds") == "Finds"
    finally:
        page.keep_nothing()
        page.open("about:blank")
        server.stop()
    assert page.complaints == []


@pytest.mark.long
def test_a_turned_map_is_clicked_dragged_and_fitted_as_it_is_seen(page: Page, url: str) -> None:
    someone = Person(page, url)
    middle = "(() => { const { x, y, width, height } = document.getElementById('pane').getBoundingClientRect();"
    middle += " return [x + width / 2, y + height / 2]; })()"
    someone.press("open-look")
    page.wait_for("!document.getElementById('look').hidden")
    page.evaluate("document.getElementById('turn-slider').value = 90; document.getElementById('turn-slider').oninput()")
    page.wait_for(f"getComputedStyle(document.getElementById('map')).rotate === '90deg' && {SHOWN_TILES} > 0")
    someone.press("side-close")
    # All of the map is in the pane, its first row of frames on the right.
    tiles = "[...document.querySelectorAll('.leaflet-tile-loaded img')].map((one) => one.getBoundingClientRect())"
    pane = "document.getElementById('pane').getBoundingClientRect()"
    assert page.evaluate(f"{tiles}.some((one) => one.right > {pane}.left && one.left < {pane}.right)")
    someone.press("open-finds")
    someone.press("finds-mark")
    page.evaluate("new Promise((done) => setTimeout(done, 300))")  # the pane has become smaller
    x, y = page.evaluate(middle)
    someone.click(x + 60, y)
    page.wait_for("!document.getElementById('finds-form').hidden")
    someone.type("finds-form", label="turned")
    page.wait_for("document.querySelectorAll('.find').length === 1")
    place = "(() => { const { x, y, width, height } = document.querySelector('.find').getBoundingClientRect();"
    place += " return [x + width / 2, y + height / 2]; })()"
    found = page.evaluate(place)
    assert abs(found[0] - x - 60) < 3
    assert abs(found[1] - y) < 3
    for kind, dx, dy in (
        ("mousePressed", 0, 0),
        ("mouseMoved", 10, 40),
        ("mouseMoved", 20, 80),
        ("mouseReleased", 20, 80),
    ):
        page.command(
            "Input.dispatchMouseEvent", type=kind, x=x - 90 + dx, y=y + dy, button="left", buttons=1, clickCount=1
        )
    page.wait_for(f"Math.abs({place}[1] - {found[1] + 80}) < 6 && Math.abs({place}[0] - {found[0] + 20}) < 6", 5)
    someone.press("open-look")
    someone.press("turn-none")
    page.wait_for("getComputedStyle(document.getElementById('map')).rotate === 'none'")


@pytest.mark.long
def test_the_map_turns_with_the_flight(page: Page, url: str, flight: SmallFlight) -> None:
    someone = Person(page, url)
    someone.press("open-look")
    someone.press("turn-flight-up")
    for step in range(1, 5):
        flight.place(f"east-{step}.jpg", 1000.0 + 200.0 * step, 0.0)
        flight.write(newest=f"east-{step}.jpg")
        page.wait_for(f"document.getElementById('counts').innerText.includes('{19 + step}')")
    page.wait_for("getComputedStyle(document.getElementById('map')).rotate === '-90deg'", 20)
    someone.press("turn-flight-up")
    someone.press("turn-none")


@pytest.mark.long
def test_what_is_missing_is_marked_where_it_should_be(page: Page, url: str, flight: SmallFlight) -> None:
    with Ledger(flight.root / LEDGER_NAME) as ledger:
        for number, name in enumerate(["10.jpg", None, "30.jpg"]):
            event = ledger.record_event(trigger_event(number, 100.0 + 2 * number))
            ledger.settle_event(event, EventState.MATCHED if name else EventState.MISSING, frame=name)
    someone = Person(page, url)
    someone.press("open-flight")
    someone.press("flight-crosses")
    page.wait_for("document.querySelectorAll('.absent').length === 1")
    assert page.evaluate("document.querySelector('.absent').title") == "no picture has come"
    box = "document.querySelector('.absent').getBoundingClientRect()"
    assert page.evaluate(f"document.elementFromPoint({box}.x + 15, {box}.y + 15).closest('.absent') !== null")
    someone.press("flight-crosses")
    page.wait_for("document.querySelectorAll('.absent').length === 0")


@pytest.mark.long
def test_the_coordinate_under_a_cursor_that_rests_is_told_by_the_anchor_as_it_is_now(page: Page, url: str) -> None:
    """It stayed as an anchor told it that was gone, with the error of that."""
    someone, writer = Person(page, url), Writer(url)
    someone.press("open-anchors")
    page.command("Input.dispatchMouseEvent", type="mouseMoved", x=400, y=300)
    for x, y, coordinate in ((0, 0, "44.5, 7.0"), (400, 0, "44.5, 7.003"), (0, 300, "44.4984, 7.0")):
        writer.send("POST", "/pins", {"island": 0, "x": x, "y": y, "coordinate": coordinate, "who": "Ann"})
    someone.sees("anchors-told", "Laid by 3 points")
    page.command("Input.dispatchMouseEvent", type="mouseMoved", x=402, y=300)
    someone.sees("coordinate", "44.")
    right = someone.text("coordinate")
    writer.send("POST", "/pins", {"island": 0, "x": 400, "y": 300, "coordinate": "44.4980, 7.0035", "who": "Ann"})
    page.wait_for(f"!['', {json.dumps(right)}].includes(document.getElementById('coordinate').innerText)")
    page.evaluate("document.querySelector('#anchors-list li:last-child button').click()")
    someone.sees("coordinate", right)
    before = right
    page.evaluate("document.querySelector('.leaflet-control-zoom-in').click()")  # elsewhere than at the cursor
    page.wait_for(f"!['', {json.dumps(before)}].includes(document.getElementById('coordinate').innerText)")
    for _ in range(2):
        page.evaluate("document.querySelector('#anchors-list li:last-child button').click()")
        page.wait_for("document.getElementById('anchors-said').textContent === ''")
        time.sleep(0.5)
    someone.sees("anchors-told", "needs two pins or more, and has 1")
    assert page.evaluate("document.getElementById('coordinate').textContent") == ""


@pytest.mark.long
def test_what_was_refused_is_not_said_any_more_once_it_is_given_up(page: Page, url: str) -> None:
    someone = Person(page, url)
    someone.press("open-anchors")
    someone.press("anchors-set")
    someone.click(300, 300)
    someone.type("anchors-form", coordinate="somewhere")
    someone.sees("anchors-said", "is no coordinate that is understood")
    someone.press("anchors-cancel")
    assert someone.text("anchors-said") == ""


@pytest.mark.long
def test_a_deleted_pin_is_brought_back(page: Page, url: str) -> None:
    someone = Person(page, url)
    Writer(url).send(
        "POST", "/pins", {"island": 0, "x": 9, "y": 9, "coordinate": "44.5, 7.0", "label": "gate", "who": "Ann"}
    )
    someone.press("open-anchors")
    someone.sees("anchors-list", "gate")
    page.evaluate("document.querySelector('#anchors-list button').click()")
    someone.sees("anchors-undo", "gate is deleted.")
    page.wait_for("document.querySelectorAll('#anchors-list li').length === 0")
    page.evaluate("document.querySelector('#anchors-undo button').click()")
    someone.sees("anchors-list", "gate")
    page.wait_for("document.getElementById('anchors-undo').hidden")
    assert page.complaints == []


@pytest.mark.long
@pytest.mark.parametrize("size", [(360, 640), (640, 360)])
def test_on_a_small_phone_a_refusal_is_in_sight(page: Page, url: str, size: tuple[int, int]) -> None:
    someone = Person(page, url, size)
    someone.press("open-anchors")
    someone.press("anchors-set")
    someone.click(150, 330)
    page.wait_for("!document.getElementById('anchors-form').hidden")
    someone.type("anchors-form", coordinate="somewhere")
    someone.sees("anchors-said", "is no coordinate that is understood")
    page.wait_for(
        """(({ top, bottom, left, right }, side) =>
      top >= side.top && bottom <= Math.min(side.bottom, innerHeight) + 1
      && document.getElementById('anchors-said').contains(document.elementFromPoint((left + right) / 2, (top + bottom) / 2))
    )(...['anchors-said', 'side'].map((id) => document.getElementById(id).getBoundingClientRect()))""",
        5.0,
    )
    assert page.complaints == []
