"""Of a damaged ledger as much as can be read goes into a new one, and the damaged one is kept."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from gcs_mosaic.check.findings import Findings, LostForGood
from gcs_mosaic.check.salvage import salvage
from gcs_mosaic.check.snapshot import integrity_problem, ledger_copy
from gcs_mosaic.check.table import verdict
from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.records import FlightRecord
from gcs_mosaic.store.schema import DamagedLedger
from tests.store.ledger_parts import a_frame

FRAMES = 500
PAGE = 4096


@pytest.fixture
def flight(tmp_path: Path) -> Path:
    with Ledger(tmp_path / LEDGER_NAME) as ledger, ledger.transaction():
        ledger.begin_flight(FlightRecord(name="flight", started_utc=1.0))
        for number in range(FRAMES):
            ledger.record_frame(a_frame(f"{number:04}.jpg"))
    return tmp_path


def damage(flight: Path, page: int, count: int = 2) -> bytes:
    """Overwrite some pages; returns the file as it is then."""
    path = flight / LEDGER_NAME
    data = bytearray(path.read_bytes())
    data[page * PAGE : (page + count) * PAGE] = os.urandom(count * PAGE)
    path.write_bytes(data)
    return bytes(data)


def is_readable(flight: Path) -> bool:
    with ledger_copy(flight, written=False) as opened:
        return not isinstance(opened, DamagedLedger)


def test_rows_on_both_sides_of_the_damage_are_saved(flight: Path) -> None:
    pages = (flight / LEDGER_NAME).stat().st_size // PAGE
    damaged = damage(flight, pages - 8)
    assert not is_readable(flight)
    salvaged = salvage(flight)
    assert (flight / f"{LEDGER_NAME}.damaged-1").read_bytes() == damaged
    assert is_readable(flight)
    with Ledger(flight / LEDGER_NAME) as ledger:
        names = [frame.name for frame in ledger.frames()]
        assert integrity_problem(ledger) is None
        assert ledger.flight() is not None
    assert 0.5 * FRAMES < len(names) < FRAMES
    assert f"read of it: flight 1, frames {len(names)}; frames could be read in part only" in salvaged.said
    assert salvaged.unread == "frames could be read in part only"
    assert {"0000.jpg", f"{FRAMES - 1:04}.jpg"} <= set(names)


def test_it_is_said_that_triggers_are_lost(flight: Path) -> None:
    """And not that the map must be made anew, where frames that are on it were read."""
    path = flight / LEDGER_NAME
    with Ledger(path) as ledger:
        ledger.write("UPDATE frames SET state = 'placed' WHERE name = '0000.jpg'")
        (root,) = ledger.rows("SELECT rootpage FROM sqlite_schema WHERE name = 'events'")[0]
    damage(flight, root - 1, 1)
    salvaged = salvage(flight)
    assert salvaged.unread == "events could not be read: triggers and their positions are lost"
    assert salvaged.said == (
        f"the damaged ledger is kept as {LEDGER_NAME}.damaged-1; read of it: flight 1, frames {FRAMES}; {salvaged.unread}"
    )
    whole = Findings("map", (), [salvaged.said], LostForGood(salvaged.unread))
    assert verdict(whole, mended=True) == f"map is whole again, but for what is lost: {salvaged.unread}"


@pytest.mark.parametrize("content", [b"", b"no database at all" * 500, None], ids=["empty", "noise", "gone"])
def test_a_file_of_which_nothing_can_be_read_is_kept_too(flight: Path, content: bytes | None) -> None:
    path = flight / LEDGER_NAME
    path.unlink() if content is None else path.write_bytes(content)
    salvaged = salvage(flight)
    assert "gcs-mosaic stitch" in salvaged.said
    assert salvaged.unread == "nothing could be read: triggers and their positions are lost"
    assert content is None or (flight / f"{LEDGER_NAME}.damaged-1").read_bytes() == content
    assert is_readable(flight)


def test_an_earlier_damaged_ledger_is_not_overwritten(flight: Path) -> None:
    (flight / f"{LEDGER_NAME}.damaged-1").write_bytes(b"earlier")
    damage(flight, 0)
    salvage(flight)
    assert (flight / f"{LEDGER_NAME}.damaged-1").read_bytes() == b"earlier"
    assert (flight / f"{LEDGER_NAME}.damaged-2").stat().st_size > PAGE
