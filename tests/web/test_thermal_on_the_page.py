"""The bar of a thermal map, and the switch for haze and dusk, in a real browser."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from gcs_mosaic.render.display import Display
from gcs_mosaic.store.disk import write_beside
from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.views.thermal_scale import ThermalScale, ThermalScales
from tests.sure import sure
from tests.web.browser import CHROMIUM, Page
from tests.web.served import served
from tests.web.small_flight import MIDDLE, SmallFlight
from tests.web.test_app import Client

IMAGE = f'img[src*="/16/{MIDDLE}/{MIDDLE}?"]'
HAZE = 4.0  # grey levels, deviation of what is seen through it
COUNTS = Display((0, 0, 0), (27_000,), (29_000,))


@pytest.fixture
def flight(flight: SmallFlight) -> SmallFlight:
    """Frames of counts without a unit; two tiles of faint structure side by side."""
    with Ledger(flight.root / LEDGER_NAME) as ledger:
        for one in ledger.painted(0):
            ledger.record_painted(replace(one, display=COUNTS, gain=(1.0,)))
    ground = cv2.GaussianBlur(np.random.default_rng(2).normal(size=(256, 512)), (0, 0), 4)
    levels = np.clip(150 + ground * (HAZE / ground.std()), 0, 255).astype(np.uint8)
    for right in (0, 1):
        path = flight.root / "tiles" / "0" / "16" / str(MIDDLE + right) / f"{MIDDLE}.jpg"
        path.parent.mkdir(parents=True, exist_ok=True)
        half = sure(cv2.merge([levels[:, 256 * right : 256 * right + 256]] * 3))
        write_beside(path, cv2.imencode(".jpg", half, [cv2.IMWRITE_JPEG_QUALITY, 95])[1].tobytes())
    flight.write()
    return flight


@pytest.fixture
def url(flight: SmallFlight) -> Iterator[str]:
    with served(flight.root) as address:
        yield address


def seen(page: Page, path: Path) -> np.ndarray:
    """What the browser shows of the ground on both sides of the tiles' border, grey (h, w)."""
    box = page.evaluate(
        f"(() => {{ const box = document.querySelector('{IMAGE}').getBoundingClientRect();"
        " return [box.left, box.top, box.width] })()"
    )
    page.screenshot(path)
    left, top, side = (round(value) for value in box)
    picture = sure(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)).astype(float)
    return picture[top + side // 10 : top + side * 3 // 10, left + side // 2 : left + side * 3 // 2]


def step_between_tiles(picture: np.ndarray) -> float:
    """At their border, in the middle, relative to what is usual."""
    steps, middle = np.abs(np.diff(picture, axis=1)).mean(axis=0), picture.shape[1] // 2
    return float(steps[middle - 2 : middle + 2].max() / steps.mean())


def test_counts_without_a_unit_are_told_as_counts(url: str) -> None:
    answer, data = Client(url).ask("/api/v1/islands/0/thermal")
    scale = json.loads(data)["scale"]
    assert (scale["kind"], scale["unit"], scale["values"]) == ("counts", "counts", [27000, 27500, 28000, 28500, 29000])
    assert Client(url).status("/api/v1/islands/0/thermal", **{"If-None-Match": answer.headers["ETag"]}) == 304
    assert json.loads(Client(url).ask("/api/v1/islands/77/thermal")[1])["scale"] is None


@pytest.mark.long
@pytest.mark.skipif(CHROMIUM is None, reason="there is no browser here")
def test_the_bar_shows_and_the_switch_makes_haze_clearer_without_borders_of_tiles(
    url: str, page: Page, tmp_path: Path
) -> None:
    page.resize(1900, 1400)
    page.open(url)
    page.wait_for("!document.getElementById('thermal').hidden")
    said = page.evaluate("document.getElementById('thermal').innerText")
    assert "Counts of the camera" in said
    assert "27000" in said
    page.wait_for(f"document.querySelector('{IMAGE}')?.complete")
    before = seen(page, tmp_path / "before.png")
    page.evaluate("document.getElementById('look-local').click()")
    page.wait_for("getComputedStyle(document.querySelector('.leaflet-tile-pane')).filter.includes('local')")
    after = seen(page, tmp_path / "after.png")
    assert after.std() > 2.5 * before.std()
    assert step_between_tiles(after) < 1.3 * step_between_tiles(before)
    page.evaluate("document.getElementById('look-plain').click()")
    np.testing.assert_array_equal(seen(page, tmp_path / "again.png"), before)
    assert page.complaints == []


@pytest.mark.long
@pytest.mark.skipif(CHROMIUM is None, reason="there is no browser here")
def test_the_legend_of_a_palette_is_shown_from_cold_to_hot(
    url: str, page: Page, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The page alone is looked at: what it is told stands in for a flight of palette pictures."""
    legend = ThermalScale("palette", "", (), ("#000020", "#8c0020", "#fa8c14", "#ffffff"), None)
    monkeypatch.setattr(ThermalScales, "of", lambda self, island: (1, legend))
    page.open(url)
    page.wait_for("!document.getElementById('thermal').hidden")
    said = page.evaluate("document.getElementById('thermal').innerText").split("\n")
    assert said[0] == "Colours of a palette"
    assert said[1:3] == ["colder", "warmer"]
    assert "one colour is not one temperature" in said[-1]
    bar = page.evaluate("getComputedStyle(document.querySelector('#thermal i')).backgroundImage")
    assert bar.startswith("linear-gradient(90deg, rgb(0, 0, 32), rgb(140, 0, 32)")
    page.screenshot(tmp_path / "legend.png")
