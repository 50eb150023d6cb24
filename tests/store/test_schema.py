from __future__ import annotations

import sqlite3
from dataclasses import replace
from pathlib import Path

import pytest

from gcs_mosaic.errors import UsageError
from gcs_mosaic.render.canvas import CanvasSettings
from gcs_mosaic.render.vignetting import FLAT, Vignetting
from gcs_mosaic.stitch.camera.dead_border import NO_BORDER
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.records import EventState, FlightRecord, FrameState
from gcs_mosaic.store.schema import VERSION, connect, connect_for_reading
from tests.store.ledger_parts import NEARLY_THE_SAME, a_frame, a_painted, an_event


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
    """Version 2: gains of blue, green and red; no display, vignetting, dead border, covered frames, or how frames are painted."""
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
    old.executescript("ALTER TABLE painted DROP COLUMN dead_border; DROP TABLE covered;")
    old.execute("PRAGMA user_version = 2")
    for column, gain in zip(("gain_b", "gain_g", "gain_r"), painted.gain, strict=True):
        old.execute(f"ALTER TABLE painted ADD COLUMN {column} NOT NULL DEFAULT {gain!r}")
    old.close()
    with Ledger(path, read_only=read_only) as ledger:
        assert ledger.painted(painted.island) == [replace(painted, vignetting=FLAT, dead=NO_BORDER)]
        canvas = CanvasSettings(blend="edge")  # the only way to mix frames that those versions had by default
        assert ledger.flight() == FlightRecord(name="old", started_utc=1.0, canvas=canvas)


@pytest.mark.parametrize(("stored", "known"), [((-0.2, 0.03), ((0.0, -0.2, 0.03),) * 3), ((0.0, 0.0), FLAT)])
def test_one_curve_of_vignetting_is_that_of_all_bands(
    tmp_path: Path, stored: tuple[float, float], known: Vignetting
) -> None:
    """Version 6."""
    path, painted = tmp_path / "flight.sqlite", a_painted("a.jpg")
    with Ledger(path) as ledger:
        ledger.record_island(painted.island)
        ledger.record_frame(a_frame("a.jpg"))
        ledger.record_painted(replace(painted, vignetting=(stored,)))  # type: ignore[arg-type]
        assert ledger.painted(painted.island) == [replace(painted, vignetting=known)]


@pytest.mark.parametrize("read_only", [True, False])
def test_a_ledger_from_before_covered_frames_is_read_and_migrated(tmp_path: Path, read_only: bool) -> None:
    """Version 5: no covered frames, and frames of that state are refused."""
    path, event = tmp_path / "flight.sqlite", an_event()
    with Ledger(path) as ledger:
        for name in ("a.jpg", "b.jpg"):
            ledger.record_frame(a_frame(name))
        ledger.settle_event(ledger.record_event(event), EventState.MATCHED, frame="b.jpg")
    old = sqlite3.connect(path)
    old.executescript("DROP TABLE covered; PRAGMA writable_schema = ON;")
    old.execute("UPDATE sqlite_schema SET sql = replace(sql, ?, '') WHERE name = 'frames'", ["'covered', "])
    old.executescript("PRAGMA writable_schema = RESET; PRAGMA user_version = 5;")
    with pytest.raises(sqlite3.IntegrityError):
        old.execute("UPDATE frames SET state = 'covered'")
    old.close()
    with Ledger(path, read_only=read_only) as ledger:
        assert ledger.covered() == []
        assert [(frame.name, frame.had_event) for frame in ledger.frames()] == [("a.jpg", False), ("b.jpg", True)]
        if not read_only:
            ledger.settle_frame("a.jpg", FrameState.PLACED)
            ledger.settle_frame("b.jpg", FrameState.COVERED)
            ledger.record_covered("b.jpg", "a.jpg", NEARLY_THE_SAME)
            assert [covered.by for covered in ledger.covered()] == ["a.jpg"]
    if not read_only:
        connection = connect(path)
        assert connection.execute("PRAGMA foreign_key_check").fetchall() == []
        assert "new_frames" not in "".join(row[0] or "" for row in connection.execute("SELECT sql FROM sqlite_schema"))
        connection.close()


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
