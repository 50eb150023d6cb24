"""A server that is there, but slow, as on a machine that has much else to do: it is not told to be away; in a real browser."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from gcs_mosaic.views.tile_reader import filled
from gcs_mosaic.web import documents, tiles
from gcs_mosaic.web import live as live_module
from tests.web.browser import CHROMIUM, Page
from tests.web.small_flight import SmallFlight

pytestmark = [pytest.mark.long, pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")]

STATE = "document.getElementById('state').innerText"
ASKED = "performance.getEntriesByType('resource').filter(({ name }) => name.includes('/status.json')).length"
SLOW_S = 6.0  # longer than the page waits for an answer at first, and than anything may be silent


@pytest.fixture
def slowly(monkeypatch: pytest.MonkeyPatch) -> Iterator[threading.Event]:
    """Once this is set each document takes long."""
    is_slow = threading.Event()
    read: Callable[[Path], Any] = documents.small_document

    def late(path: Path) -> Any:
        if is_slow.is_set():
            time.sleep(SLOW_S)
        return read(path)

    monkeypatch.setattr(documents, "small_document", late)
    yield is_slow
    is_slow.clear()
    time.sleep(
        SLOW_S
    )  # what was asked for is answered, or its connection would be closed by the end of the server alone


def states(page: Page, seconds: float) -> set[str]:
    """All that the line of state says meanwhile."""
    end, found = time.monotonic() + seconds, set[str]()
    while time.monotonic() < end:
        found.add(page.evaluate(STATE))
        time.sleep(0.1)
    return found


def test_late_answers_are_told_to_be_late_and_still_come(
    page: Page, url: str, flight: SmallFlight, slowly: threading.Event
) -> None:
    flight.status()
    page.open(url)
    page.wait_for(f"{STATE}.includes('Flying')")
    slowly.set()
    told = states(page, 2 * SLOW_S)
    assert not any("No connection" in one for one in told), told
    assert any("Answers late" in one and "What you see is from" in one for one in told), told
    flight.status(state="stopped")  # told by an answer that takes as long
    page.wait_for(f"{STATE}.includes('Flight ended')", 5 * SLOW_S)


def test_a_server_that_sends_nothing_at_all_is_away(
    page: Page, url: str, flight: SmallFlight, slowly: threading.Event, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(live_module, "HEARTBEAT_S", 60.0)
    flight.status()
    page.open(url)
    page.wait_for(f"{STATE}.includes('Flying')")
    slowly.set()
    page.wait_for(f"{STATE}.includes('No connection')", 3 * SLOW_S)
    slowly.clear()
    flight.status()
    page.wait_for(f"{STATE}.includes('Flying')", 3 * SLOW_S)


def test_the_state_does_not_wait_behind_tiles(
    page: Page, url: str, flight: SmallFlight, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nobody answers to any tile, of which many are in view: the state of the flight is asked for and told as ever."""
    go_on = threading.Event()

    def held(*given: Any) -> Any:
        go_on.wait(60)
        return filled(*given)

    monkeypatch.setattr(tiles, "filled", held)
    try:
        flight.status()
        page.open(url)
        page.wait_for(f"{STATE}.includes('Flying')")
        before = page.evaluate(ASKED)
        flight.status(state="idle")
        page.wait_for(f"{STATE}.includes('Idle')", 5)
        told = states(page, 6)
        assert not any("No connection" in one or "late" in one for one in told), told
        assert page.evaluate(ASKED) > before + 2
    finally:
        go_on.set()
    page.wait_for("document.querySelectorAll('.on-its-way').length === 0")
    assert page.evaluate("document.querySelectorAll('.leaflet-tile-loaded img').length") > 5
