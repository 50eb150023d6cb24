"""A page that is left open while another flight of the same name is served in its place, as `mosaic` of two days is."""

from __future__ import annotations

import urllib.request
from pathlib import Path

import pytest

from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.records import FlightRecord
from tests.ports import free_port
from tests.web.browser import CHROMIUM, Page
from tests.web.seen_flight import seen_flight
from tests.web.served import served
from tests.web.small_flight import SmallFlight

STATE = "(document.getElementById('strip')?.innerText ?? '')"  # of a page that begins anew there is none for a moment


def flown_later(root: Path) -> SmallFlight:
    """A flight that is called as `seen_flight` is; its map has a later revision."""
    root.mkdir()
    with Ledger(root / LEDGER_NAME) as ledger:
        ledger.begin_flight(FlightRecord(name="small", started_utc=2.0))
    flight = SmallFlight(root)
    for k in range(3):
        flight.place(f"{k}.jpg", 128.0 * k, 128)
        flight.write()
    return flight


def which(url: str) -> str:
    with urllib.request.urlopen(f"{url}/mosaic.json") as answer:
        return str(answer.headers["X-Flight"])


def test_flights_of_one_name_are_told_apart_and_one_is_the_same_after_a_restart(tmp_path: Path) -> None:
    (tmp_path / "one").mkdir()
    seen_flight(tmp_path / "one").write()
    flown_later(tmp_path / "two")
    told = []
    for name in ("one", "two", "one"):
        with served(tmp_path / name) as url:
            told.append(which(url.rstrip("/")))
    assert told[0] == told[2] != told[1]


@pytest.mark.long
@pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")
def test_the_page_begins_anew(page: Page, tmp_path: Path) -> None:
    (tmp_path / "one").mkdir()
    first, port = seen_flight(tmp_path / "one"), free_port()
    first.write()
    first.status(state="stopped")
    with served(first.root, port=port) as url:
        page.open(url)
        page.wait_for(f"{STATE}.includes('Flight ended')")
    flown_later(tmp_path / "two")  # a saved one, without a status
    with served(tmp_path / "two", port=port):
        page.wait_for(f"{STATE}.includes('1 frame')")
        page.wait_for(f"{STATE}.includes('Saved flight')")
        page.open("about:blank")
