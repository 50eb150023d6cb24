"""The folder of a flight that is looked at is deleted, or its disk is pulled: nothing left over passes for the map."""

from __future__ import annotations

import urllib.error
import urllib.request

import pytest

from tests.web.browser import CHROMIUM, Page
from tests.web.small_flight import MIDDLE, SmallFlight

STATE = "document.getElementById('state').querySelector('b').textContent"


@pytest.mark.long
@pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")
@pytest.mark.parametrize("is_live", [False, True])
def test_it_is_an_alarm_until_it_is_back(page: Page, url: str, flight: SmallFlight, is_live: bool) -> None:
    """A saved flight went on as "Saved flight", over ground that looked as if nobody had seen it."""
    if is_live:
        flight.status()
    page.open(url)
    page.wait_for(f"{STATE} === '{'Flying' if is_live else 'Saved flight'}'")
    page.wait_for("document.querySelectorAll('.leaflet-tile-loaded img').length > 0")
    elsewhere = flight.root.rename(flight.root.with_name("elsewhere"))
    page.wait_for(f"{STATE} === 'Folder gone'")
    page.wait_for("document.getElementById('alarm').innerText.includes('may have been seen. What you see is from')")
    assert page.evaluate("document.querySelectorAll('.leaflet-tile-loaded img').length > 0"), "what was shown stays"
    with pytest.raises(urllib.error.HTTPError) as refused:
        urllib.request.urlopen(f"{url}tiles/0/16/{MIDDLE + 5}/{MIDDLE}.jpg", timeout=20)
    with refused.value as answer:
        assert answer.code == 503
    elsewhere.rename(flight.root)
    if is_live:
        flight.status()
    page.wait_for(f"{STATE} === '{'Flying' if is_live else 'Saved flight'}'")
    assert page.evaluate("document.getElementById('alarm').hidden")
