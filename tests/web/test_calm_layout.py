"""What stands on the page lies over nothing else, is cut off nowhere, and leaves the map its room.

At five sizes, with one, two and four aircraft, with none to three conditions, in both languages; measured in a real browser.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from gcs_mosaic.store.manifest import IslandEntry
from gcs_mosaic.store.status import AircraftStatus, Condition
from tests.web.browser import CHROMIUM, Page
from tests.web.seen_flight import seen_flight
from tests.web.served import served
from tests.web.small_flight import SmallFlight

pytestmark = [pytest.mark.long, pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")]

SIZES = [(1366, 768), (1024, 768), (400, 800), (844, 390), (1920, 1080)]
MAP_SHARE = {
    (400, 800): 0.75,
    (844, 390): 0.75,
    (1024, 768): 0.85,
    (1366, 768): 0.85,
    (1920, 1080): 0.85,
}  # of the screen
SENTENCES = [
    (
        "error",
        "the disk is full: free some space, then it goes on (/srv/flights/FIELD-SSD/2026-11-27 search/mosaic/flight.sqlite "
        "could not be written)",
    ),
    ("warning", "The last 3 frames match nothing on the map: fly back over ground that is on it"),
    (
        "warning",
        "Aircraft 2 is silent while others are heard: see whether it is out of reach. Its pictures are mapped meanwhile",
    ),
]
# All that somebody reads or presses and that can be seen; of what scrolls the part that shows.
BOXES = """(() => {
  const shown = (one) => one.checkVisibility({ visibilityProperty: true, opacityProperty: true });
  const controls = "button, select, input, textarea, a[href], summary";
  const texts = "output, h2, h3, label, #side p, #legend, #thermal, #scale-bar, #north, #alarm, #farewell, #state b, #state span";
  const isElsewhere = (one) => one.closest(".leaflet-pane, dialog") !== null;
  const found = [...document.querySelectorAll(`${controls}, ${texts}`)].filter((one) => shown(one) && !isElsewhere(one));
  const cut = (one) => {
    let { left, top, right, bottom } = one.getBoundingClientRect();
    for (let over = one.parentElement; over; over = over.parentElement) {
      if (!/auto|scroll|hidden/.test(getComputedStyle(over).overflow)) continue;
      const box = over.getBoundingClientRect();
      [left, top] = [Math.max(left, box.left), Math.max(top, box.top)];
      [right, bottom] = [Math.min(right, box.right), Math.min(bottom, box.bottom)];
    }
    return [left, top, right, bottom];
  };
  const scrolls = (one) => one.closest("#side, #sheet") !== null;
  const scrollsAcross = (one) => /auto|scroll/.test(getComputedStyle(one.parentElement).overflowX);
  const name = (one) => one.id || `${one.localName} ${one.innerText || one.ariaLabel || ""}`;
  return { found, cut, scrolls, scrollsAcross, name };
})()"""
FAULTS = f"""(() => {{
  const {{ found, cut, scrolls, scrollsAcross, name }} = {BOXES};
  const faults = [];
  const boxes = found.map((one) => [one, cut(one)]).filter(([, [l, t, r, b]]) => r - l > 1 && b - t > 1);
  const head = document.querySelector("#side > header");
  boxes.forEach(([one, [left, top, right, bottom]], at) => {{
    const inPanel = (node) => node.closest("#side") && !head.contains(node); // which scrolls under its head
    for (const [other, [l, t, r, b]] of boxes.slice(at + 1)) {{
      if (one.contains(other) || other.contains(one) || inPanel(one) !== inPanel(other)) continue;
      const [across, down] = [Math.min(right, r) - Math.max(left, l), Math.min(bottom, b) - Math.max(top, t)];
      if (across > 1 && down > 1) faults.push(`${{name(one)}} lies over ${{name(other)}}`);
    }}
    const whole = one.getBoundingClientRect();
    const isAcross = !scrollsAcross(one) && (whole.left < -1 || whole.right > innerWidth + 1);
    const isOut = isAcross || (!scrolls(one) && (whole.top < -1 || whole.bottom > innerHeight + 1));
    const isCut = !scrolls(one) && (whole.width - (right - left) > 1 || whole.height - (bottom - top) > 1);
    const isFull = one.scrollWidth > one.clientWidth + 1 || one.scrollHeight > one.clientHeight + 1;
    const isTight = one.localName === "button" && isFull;
    if (isOut || isCut || isTight) faults.push(`${{name(one)}} is cut off`);
  }});
  return faults;
}})()"""
THERMAL = """(() => {
  const box = document.getElementById("thermal");
  const texts = ["Temperatur, °C", "", "", 
    "Wie die Kamera es sagt, ohne Emissionsgrad und Luft; 19 von 20 Pixeln liegen auf 1.49 °C daran."];
  [...box.children].forEach((one, at) => { one.textContent = texts[at]; });
  box.hidden = false;
})()"""
SHARE = """(({ left, top, right, bottom }) => (right - left) * (bottom - top) / (innerWidth * innerHeight))
(document.getElementById("map").getBoundingClientRect())"""


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> SmallFlight:
    flight = seen_flight(tmp_path_factory.mktemp("flight"))
    flight.islands += [
        IslandEntry(id=n, bounds=(0, 0, 512, 512), minzoom=14, maxzoom=16, frames=10 - n) for n in range(1, 6)
    ]
    flight.write()
    return flight


@pytest.fixture(scope="module")
def url(flight: SmallFlight, page: Page) -> Iterator[str]:
    with served(flight.root) as address:
        yield address
        page.open("about:blank")


def told(flight: SmallFlight, aircraft: int, conditions: int) -> None:
    lasting = tuple(
        Condition(key=str(at), level=level, text=text, since_utc=1.7e9)  # type: ignore[arg-type]
        for at, (level, text) in enumerate(SENTENCES[:conditions])
    )
    several = tuple(AircraftStatus(system=one + 1) for one in range(aircraft)) if aircraft > 1 else ()
    flight.status(aircraft=several, conditions=lasting)


def shows(page: Page, aircraft: int, conditions: int) -> None:
    chips = aircraft if aircraft > 1 else 0
    page.wait_for(f"[...document.querySelectorAll('#fleet button')].length === {chips} || {chips} === 0")
    page.wait_for(f"document.getElementById('fleet').hidden === {str(chips == 0).lower()}")
    page.wait_for(f"document.querySelectorAll('#conditions li').length === {conditions}")


def opened(page: Page, url: str, size: tuple[int, int], language: str) -> None:
    page.resize(*size)
    page.open(url)
    page.evaluate(f"localStorage.setItem('gcs-mosaic language', '{language}')")
    page.open(url)
    page.wait_for("document.querySelectorAll('.leaflet-tile-loaded img').length > 0")
    page.wait_for("/[1-9]/.test(document.getElementById('gaps').textContent)")


@pytest.mark.parametrize("language", ["en", "de"])
@pytest.mark.parametrize("size", SIZES, ids=str)
def test_nothing_lies_over_anything_else(
    page: Page, url: str, flight: SmallFlight, size: tuple[int, int], language: str
) -> None:
    faults: dict[str, Any] = {}
    told(flight, 1, 0)
    opened(page, url, size, language)
    for aircraft, conditions in ((1, 0), (2, 1), (4, 2), (4, 3)):
        told(flight, aircraft, conditions)
        shows(page, aircraft, conditions)
        for phase in ("", "fly", "look", "report", "page"):
            if phase:
                page.evaluate(f"document.getElementById('phase-{phase}').click()")
            if found := page.evaluate(FAULTS):
                faults[f"{aircraft} aircraft, {conditions} conditions, {phase or 'nothing'} open"] = found
        page.evaluate("document.getElementById('side-close').click()")
    assert faults == {}


@pytest.mark.parametrize("size", SIZES, ids=str)
def test_what_is_shown_over_the_map_finds_its_place(
    page: Page, url: str, flight: SmallFlight, size: tuple[int, int]
) -> None:
    """A layer's legend, a thermal bar, a tool that points, a coordinate, a scale, north, an answer, all at once; the alarm."""
    told(flight, 4, 1)
    opened(page, url, size, "de")
    page.evaluate(
        "(s => { s.value = 'sharpness'; s.dispatchEvent(new Event('change')); })(document.getElementById('layer'))"
    )
    page.evaluate("document.getElementById('finds-mark').click()")
    for name, text in (
        ("finds-hidden", "125 Funde ausgeblendet"),
        ("coordinate", "44.512340, 7.123450 ± 12 m (95 %)"),
        ("scale-bar", "50 m"),
        ("answer", "Frage …"),
    ):
        page.evaluate(f"Object.assign(document.getElementById('{name}'), {{ hidden: false, textContent: '{text}' }})")
    page.evaluate("document.getElementById('scale-bar').style.width = '110px'")
    page.evaluate(THERMAL)
    page.evaluate("document.getElementById('north').hidden = false")
    page.wait_for("!document.getElementById('legend').hidden && !document.getElementById('hint').hidden")
    assert page.evaluate(FAULTS) == []
    page.evaluate("document.getElementById('hint-end').click()")
    page.evaluate("Date.now = (now => () => now() - 60000)(Date.now)")
    flight.status(updated_utc=1714564800.0)
    page.wait_for("!document.getElementById('alarm').hidden")
    assert page.evaluate(FAULTS) == []


@pytest.mark.parametrize("size", SIZES, ids=str)
def test_the_map_has_most_of_the_screen(page: Page, url: str, flight: SmallFlight, size: tuple[int, int]) -> None:
    told(flight, 4, 3)
    opened(page, url, size, "en")
    shows(page, 4, 3)
    assert page.evaluate(SHARE) >= MAP_SHARE[size]


def test_a_long_state_stands_beside_its_light_on_a_phone(page: Page, tmp_path: Path) -> None:
    """It was broken off below its light where frames and gaps take half of the line."""
    flight = seen_flight(tmp_path)
    with served(flight.root) as url:
        flight.status(updated_utc=time.time() - 60)
        opened(page, url, (400, 800), "de")
        page.wait_for("document.getElementById('state').className === 'bad'")
        light, title = (f"document.querySelector('#state {one}').getBoundingClientRect()" for one in ("i", "b"))
        assert page.evaluate(f"{light}.right <= {title}.left && {title}.top < {light}.bottom")
        assert page.evaluate(f"{title}.height < 40"), "in one line"
        page.open("about:blank")


def test_a_find_can_be_placed_on_a_phone(page: Page, url: str, flight: SmallFlight) -> None:
    """While a place is pointed at the panel makes room; the place is marked as long as its form is open."""
    told(flight, 1, 0)
    opened(page, url, (400, 800), "en")
    page.evaluate("document.getElementById('phase-report').click()")
    page.evaluate("document.getElementById('finds-mark').click()")
    assert page.evaluate(SHARE) >= MAP_SHARE[400, 800]
    for kind in ("mousePressed", "mouseReleased"):
        page.command("Input.dispatchMouseEvent", type=kind, x=200, y=400, button="left", clickCount=1)
    page.wait_for("!document.getElementById('finds-form').hidden")
    assert page.evaluate("document.querySelectorAll('.chosen-place').length") == 1
    page.evaluate("document.getElementById('finds-cancel').click()")
    assert page.evaluate("document.querySelectorAll('.chosen-place').length") == 0


def test_what_is_not_in_view_is_always_told(page: Page, url: str, flight: SmallFlight) -> None:
    told(flight, 1, 0)
    opened(page, url, (1366, 768), "en")
    page.wait_for("document.getElementById('parts').innerText === '19 of 54 frames here, 5 more parts, 1 gap'")
    page.evaluate("document.getElementById('parts').click()")
    page.wait_for("!document.getElementById('islands').hidden")
    assert page.evaluate("document.getElementById('all').innerText") == "This whole part"
