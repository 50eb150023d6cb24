"""Printed, the page shows the whole map, and a tab says of which flight it is."""

from __future__ import annotations

import pytest

from tests.web.browser import CHROMIUM, Page

pytestmark = [pytest.mark.long, pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")]

SHEETS = {"A4": (297, 210), "Letter": (279, 216)}  # mm, lying
MARGIN_MM = 10
PX_PER_MM = 96 / 25.4


@pytest.mark.parametrize("size", [(1366, 768), (1920, 1080), (800, 1000)])
def test_the_map_fits_on_a_sheet_of_paper(page: Page, url: str, size: tuple[int, int]) -> None:
    page.resize(*size)
    page.open(url)
    page.wait_for("document.querySelectorAll('.leaflet-tile-loaded').length > 0")
    page.evaluate("dispatchEvent(new Event('beforeprint'))")
    page.command("Emulation.setEmulatedMedia", media="print")
    left, top, right, bottom = page.evaluate(
        "(({ left, top, right, bottom }) => [left, top, right, bottom])(document.getElementById('map').getBoundingClientRect())"
    )
    assert min(left, top) >= 0
    for wide, high in SHEETS.values():
        assert right <= (wide - 2 * MARGIN_MM) * PX_PER_MM
        assert bottom <= (high - 2 * MARGIN_MM) * PX_PER_MM
    assert right - left > 300, "and is not made small for nothing"


def test_a_tab_tells_the_flight(page: Page, url: str) -> None:
    page.open(url)
    page.wait_for("document.title.endsWith(' · gcs-mosaic')")
    assert page.evaluate("document.title") == page.evaluate(
        "fetch('mosaic.json').then((one) => one.json()).then(({ flight }) => `${flight} · gcs-mosaic`)"
    )
