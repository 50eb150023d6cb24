from __future__ import annotations

import sqlite3
from dataclasses import replace
from pathlib import Path

import pytest
from ledger_parts import a_frame, a_painted

from gcs_mosaic.errors import UsageError
from gcs_mosaic.flight.ledger import Ledger
from gcs_mosaic.flight.records import FlightRecord
from gcs_mosaic.flight.schema import VERSION, connect, connect_for_reading
from gcs_mosaic.stitch.painting.canvas import CanvasSettings
from gcs_mosaic.stitch.painting.vignetting import FLAT


def test_new_file_carries_our_version_and_a_write_ahead_log(tmp_path: Path) -> None:
    connection = connect(tmp_path / "flight.sqlite")
    assert connection.execute("PRAGMA user_version").fetchone()[0] == VERSION
    assert connection.execute("PRAGMA journal_mode").fetchone()[0] == "wal"
    assert connection.execute("PRAGMA synchronous").fetchone()[0] == 1
    connection.close()


@pytest.mark.parametrize("open_file", [connect, connect_for_reading])
def test_newer_version_is_refused_and_left_alone(tmp_path: Path, open_file: type) -> None:
    path = tmp_path / "flight.sqlite"
    connection = connect(path)
    connection.execute(f"PRAGMA user_version = {VERSION + 1}")
    connection.close()
    before = path.read_bytes()
    with pytest.raises(
        UsageError, match=rf"newer gcs-mosaic \(ledger version {VERSION + 1}, this one knows up to {VERSION}\)"
    ):
        open_file(path)
    assert path.read_bytes() == before


@pytest.mark.parametrize("read_only", [True, False])
def test_a_ledger_with_three_gains_is_read_and_migrated(tmp_path: Path, read_only: bool) -> None:
    """Version 2: gains of blue, green and red, no display, no vignetting, no word of how frames are painted."""
    path = tmp_path / "flight.sqlite"
    painted = a_painted("a.jpg")
    with Ledger(path) as ledger:
        ledger.begin_flight(FlightRecord(name="old", started_utc=1.0))
        ledger.record_island(painted.island)
        ledger.record_frame(a_frame("a.jpg"))
        ledger.record_painted(painted)
    old = sqlite3.connect(path)
    old.executescript("ALTER TABLE flight DROP COLUMN canvas; ALTER TABLE painted DROP COLUMN display;")
    old.executescript("ALTER TABLE painted DROP COLUMN gain; ALTER TABLE painted DROP COLUMN vignetting;")
    old.execute("PRAGMA user_version = 2")
    for column, gain in zip(("gain_b", "gain_g", "gain_r"), painted.gain, strict=True):
        old.execute(f"ALTER TABLE painted ADD COLUMN {column} NOT NULL DEFAULT {gain!r}")
    old.close()
    with Ledger(path, read_only=read_only) as ledger:
        assert ledger.painted(painted.island) == [replace(painted, vignetting=FLAT)]
        canvas = CanvasSettings(blend="edge")  # the only way to mix frames that those versions had by default
        assert ledger.flight() == FlightRecord(name="old", started_utc=1.0, canvas=canvas)


def test_database_of_another_program_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "flight.sqlite"
    foreign = sqlite3.connect(path)
    foreign.execute("CREATE TABLE birds (name)")
    foreign.close()
    with pytest.raises(UsageError, match="belongs to another program"):
        connect(path)


def test_file_that_is_no_database_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "flight.sqlite"
    path.write_bytes(b"not a database, but long enough to be taken for one" * 100)
    with pytest.raises(UsageError, match="is not a flight's ledger"):
        connect(path)


def test_reading_makes_no_file(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="does not exist"):
        connect_for_reading(tmp_path / "flight.sqlite")
    assert list(tmp_path.iterdir()) == []
