"""A panel's head leaves its panel room, questions stand beside their answers, and one line of state is one line.

In German, whose words are longest, at the sizes of a phone, upright and on its side, a tablet and a laptop.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from gcs_mosaic.store.manifest import IslandEntry
from gcs_mosaic.store.status import AircraftStatus, Condition
from gcs_mosaic.web.address import HttpAddress
from gcs_mosaic.web.server import WebServer
from tests.sure import sure
from tests.web.browser import CHROMIUM, Page
from tests.web.seen_flight import seen_flight
from tests.web.served import served
from tests.web.small_flight import SmallFlight

pytestmark = [pytest.mark.long, pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")]

SIZES = [(390, 844), (820, 1180), (1366, 768)]
LOW = [(844, 390), (667, 375), (683, 384)]  # phones on their side, a laptop at 200 %
ROW = 44 + 8  # CSS pixels of what is pressed, and of the space below


@pytest.fixture(scope="module")
def url(tmp_path_factory: pytest.TempPathFactory, page: Page) -> Iterator[str]:
    server = WebServer(seen_flight(tmp_path_factory.mktemp("flight")).root, HttpAddress("127.0.0.1", 0))
    yield server.start()
    page.open("about:blank")
    server.stop()


@pytest.fixture(params=SIZES, ids=str)
def opened(request: pytest.FixtureRequest, page: Page, url: str) -> Page:
    in_german(page, url, request.param)
    return page


def in_german(page: Page, url: str, size: tuple[int, int]) -> None:
    page.resize(*size)
    page.open(url)
    page.evaluate("localStorage.setItem('gcs-mosaic language', 'de')")
    page.open(url)
    page.wait_for("document.querySelectorAll('.leaflet-tile-loaded img').length > 0")


def apart(page: Page, one: str, other: str) -> float:
    """CSS pixels that the middles of two elements lie apart, down the screen."""
    return float(
        page.evaluate(f"""(([one, other]) => Math.abs(one - other))(['{one}', '{other}'].map((id) => {{
          const {{ top, bottom }} = document.getElementById(id).getBoundingClientRect();
          return (top + bottom) / 2;
        }}))""")
    )


def test_a_panels_head_is_a_title_with_its_end_and_two_rows_of_tabs(opened: Page) -> None:
    panels = opened.evaluate("[...document.querySelectorAll('section.panel')].map(({ id }) => id)")
    assert len(panels) > 10
    for name in panels:
        opened.evaluate(f"document.getElementById('open-{name}').click()")
        assert apart(opened, "side-title", "side-close") <= 4, name
        height = opened.evaluate("document.querySelector('#side > header').offsetHeight")
        assert height <= 3 * ROW + 16, name
        assert opened.evaluate("document.getElementById('side').scrollWidth <= innerWidth"), name


@pytest.mark.parametrize("size", LOW, ids=str)
def test_in_a_low_window_a_panel_has_its_height_beside_the_map(page: Page, url: str, size: tuple[int, int]) -> None:
    """Its head is one line, in which the tab of the open panel can be seen."""
    in_german(page, url, size)
    page.evaluate("void (window.box = (id) => document.getElementById(id).getBoundingClientRect())")
    for name in page.evaluate("[...document.querySelectorAll('section.panel')].map(({ id }) => id)"):
        page.evaluate(f"document.getElementById('open-{name}').click()")
        head = "document.querySelector('#side > header').getBoundingClientRect()"
        assert page.evaluate(f"(box('side').bottom - {head}.bottom) / innerHeight") >= 0.6, name
        assert page.evaluate("box('pane').width") >= 0.4 * size[0], name
        assert page.evaluate("pane.offsetLeft + pane.offsetWidth <= side.offsetLeft"), name
        assert page.evaluate("box('pane').height") >= 0.8 * size[1], name
        assert page.evaluate("side.offsetLeft + side.offsetWidth <= innerWidth"), name
        tab = f"box('open-{name}')"
        if not page.evaluate("document.getElementById('tabs').hidden"):
            assert page.evaluate(f"{tab}.left >= box('tabs').left - 1 && {tab}.right <= box('tabs').right + 1"), name


def test_in_a_low_window_the_state_is_told_beside_many_parts(page: Page, flight: SmallFlight) -> None:
    flight.islands += [IslandEntry(id=n, bounds=(0, 0, 512, 512), minzoom=14, maxzoom=16, frames=9) for n in (1, 2)]
    flight.write()
    flight.status(conditions=(Condition(key="islands", level="warning", text="The map is in parts", since_utc=1.7e9),))
    with served(flight.root) as own:
        in_german(page, own, (667, 375))
        page.wait_for("document.querySelectorAll('#conditions li').length === 1")
        page.wait_for("document.getElementById('parts').innerText.includes('weitere Teile')")
        assert page.evaluate("document.querySelector('#state b').getBoundingClientRect().right") < page.evaluate(
            "document.querySelector('#state span').getBoundingClientRect().left"
        )
        assert page.evaluate("document.querySelector('#state span').getBoundingClientRect().width") > 120
        page.open("about:blank")


def test_a_question_of_the_mission_takes_no_more_than_three_lines(opened: Page) -> None:
    opened.evaluate("document.getElementById('open-mission').click()")
    heights = opened.evaluate("[...document.querySelectorAll('#mission-form label')].map((one) => one.offsetHeight)")
    line = opened.evaluate("parseFloat(getComputedStyle(document.body).fontSize) * 1.3")
    assert len(heights) == 4
    assert max(heights) <= max(44, 3 * line) + 1


def test_a_state_without_anything_to_see_to_is_one_line(opened: Page) -> None:
    """On a phone, too: the number of frames stands beside it."""
    assert apart(opened, "parts", "state") <= 8


def test_night_is_red_in_legends_and_among_looks_too(page: Page, url: str, tmp_path: Path) -> None:
    """Eyes that are used to the dark see green and blue long afterwards."""
    page.resize(1366, 768)
    page.open(url)
    page.wait_for("document.querySelectorAll('#layer option').length > 3")
    page.evaluate("document.documentElement.dataset.theme = 'night'")
    page.evaluate(
        "(s => { s.value = 'sharpness'; s.dispatchEvent(new Event('change')); })(document.getElementById('layer'))"
    )
    page.wait_for("!document.getElementById('legend').hidden")
    assert colours(page, "#legend i", tmp_path) == (True, True)
    page.evaluate("""(() => {
      for (const name of ["originals", "originals-looks"]) document.getElementById(name).hidden = false;
      document.querySelector("#originals-looks ol").innerHTML = "<li><button><span class='coming'></span></button></li>";
    })()""")
    assert colours(page, "#originals-looks span", tmp_path) == (True, True)


def test_chips_of_aircraft_are_red_at_night(page: Page, flight: SmallFlight, tmp_path: Path) -> None:
    page.resize(1366, 768)
    flight.status(aircraft=tuple(AircraftStatus(system=system) for system in (1, 2, 3, 4)))
    with served(flight.root) as own:
        page.open(own)
        page.wait_for("document.querySelectorAll('#fleet button').length === 4")
        page.evaluate("document.documentElement.dataset.theme = 'night'")
        assert colours(page, "#fleet", tmp_path) == (True, True)
        page.open("about:blank")


def colours(page: Page, what: str, folder: Path) -> tuple[bool, bool]:
    """Whether an element shows anything, and nothing but red, as far as a screen goes."""
    page.screenshot(folder / "night.png")
    left, top, right, bottom = page.evaluate(
        f"(({{ left, top, right, bottom }}) => [left, top, right, bottom].map(Math.round))"
        f"(document.querySelector('{what}').getBoundingClientRect())"
    )
    shown = sure(cv2.imread(str(folder / "night.png")))[top:bottom, left:right].astype(int)
    blue, green, red = shown.reshape(-1, 3).T
    return bool(red.max() > 100), bool((np.maximum(blue, green) <= 0.5 * red + 10).all())


def test_what_was_measured_of_a_few_pictures_is_no_figure(opened: Page) -> None:
    """The number stands large only once all of them are measured."""
    told = "{ by: 'anchor', flown: 0.93, seen: 0.93, covered: 0.09, frames: 75, person_px: 4 }"
    opened.evaluate(
        "import('/viewer/page.js').then(({ modules }) => { window.Detection = modules.detection.Detection; })"
    )
    opened.wait_for("!!window.Detection")
    sizes = [
        opened.evaluate(f"""(() => {{
          const told = document.getElementById('detection-told');
          const part = document.getElementById('detection-part');
          document.getElementById('open-detection').click();
          Detection.prototype.tell.call({{ told, part }}, {{ ...{told}, measured: {measured} }});
          return parseFloat(getComputedStyle(told).fontSize);
        }})()""")
        for measured in (3, 75)
    ]
    assert sizes[0] < sizes[1]
