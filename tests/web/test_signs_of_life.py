"""A flight that gives no sign of life: on a busy machine that is told calmly at first, and as an alarm when it lasts."""

from __future__ import annotations

import time

import pytest

from gcs_mosaic.store.status import Condition
from tests.web.browser import CHROMIUM, Page
from tests.web.small_flight import SmallFlight

pytestmark = [pytest.mark.long, pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")]

STATE = "document.getElementById('state')"
LASTING = (Condition(key="islands", level="warning", text="The map is in 2 parts", since_utc=1.7e9),)


@pytest.mark.parametrize(
    ("silent_s", "kind", "title"), [(2, "warn", "Flying"), (14, "warn", "Nothing new"), (45, "bad", "Not responding")]
)
def test_silence_is_told_by_how_long_it_lasts(
    page: Page, url: str, flight: SmallFlight, silent_s: float, kind: str, title: str
) -> None:
    """Since when what is shown is old goes before what lasts: that has its chip."""
    flight.status(updated_utc=time.time() - silent_s, conditions=LASTING)
    page.open(url)
    page.wait_for(f"{STATE}.className === '{kind}' && {STATE}.querySelector('b').textContent === '{title}'")
    told = page.evaluate(f"{STATE}.innerText + document.getElementById('alarm').innerText")
    assert ("What you see is from" in told) is (silent_s > 10)
    assert page.evaluate("document.getElementById('alarm').hidden") is (kind != "bad")
