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


JUST_BACK = """(async (lostMs, heardMs) => {
  const [{ Connection }, { showStrip }] = await Promise.all([import('/viewer/server.js'), import('/viewer/strip.js')]);
  const [status, now] = [await (await fetch('/status.json')).json(), Date.now()];
  const connection = new Connection();
  connection.lastSign = connection.lastAnswer = now - lostMs;
  connection.sign();
  connection.lastAnswer = now;  // the map's, whose status is still being asked for
  connection.backAt -= heardMs;
  showStrip({ mosaic: null, newestFrame: null, status, statusAt: now - lostMs, hasEnded: false, isGone: false }, connection, 0);
  return document.querySelector('#state b').textContent;
})"""


@pytest.mark.parametrize(("heard_s", "title"), [(0.5, "Nothing new"), (6, "Not responding")])
def test_after_a_hole_in_the_network_a_flight_is_not_called_dead_before_it_was_asked(
    page: Page, url: str, flight: SmallFlight, heard_s: float, title: str
) -> None:
    """By a status that came before; but one that does not come then either is none."""
    flight.status(updated_utc=time.time() - 45, conditions=LASTING)
    page.open(url)
    page.wait_for(f"{STATE}.querySelector('b').textContent === 'Not responding'")
    assert page.evaluate(f"{JUST_BACK}({45_000 - 1000 * heard_s}, {1000 * heard_s})") == title
