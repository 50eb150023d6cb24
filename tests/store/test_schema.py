from __future__ import annotations

import json
import sqlite3
from dataclasses import replace
from pathlib import Path

import pytest

from gcs_mosaic.cli import main as cli
from gcs_mosaic.errors import UsageError
from gcs_mosaic.messages import Notice
from gcs_mosaic.render.compositor import CompositorSettings
from gcs_mosaic.render.vignetting import FLAT, Vignetting
from gcs_mosaic.stitch.camera.dead_border import NO_BORDER
from gcs_mosaic.stitch.camera.geometry import Pose
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.records import EventState, FlightRecord, FrameState
from gcs_mosaic.store.schema import MIGRATIONS, VERSION, connect, connect_for_reading
from tests.ports import free_port
from tests.store.ledger_parts import NEARLY_THE_SAME, a_frame, a_painted, an_estimate, an_event
from tests.sure import sure


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
    old.executescript("ALTER TABLE painted DROP COLUMN dead_border; DROP TABLE covered; DROP TABLE recorded;")
    old.executescript("ALTER TABLE painted DROP COLUMN overlay; ALTER TABLE painted DROP COLUMN light;")
    old.execute("ALTER TABLE painted DROP COLUMN picture_area")
    old.execute("ALTER TABLE estimates DROP COLUMN focal_log_deviation")
    old.execute("ALTER TABLE frames DROP COLUMN vehicle")
    old.execute("ALTER TABLE frames DROP COLUMN sharpness")
    old.execute("PRAGMA user_version = 2")
    for column, gain in zip(("gain_b", "gain_g", "gain_r"), painted.gain, strict=True):
        old.execute(f"ALTER TABLE painted ADD COLUMN {column} NOT NULL DEFAULT {gain!r}")
    old.close()
    with Ledger(path, read_only=read_only) as ledger:
        assert ledger.painted(painted.island) == [
            replace(painted, vignetting=FLAT, light=None, dead=NO_BORDER, still=None, area=None)
        ]
        canvas = CompositorSettings(blend="edge")  # the only way to mix frames that those versions had by default
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
    old.executescript("ALTER TABLE painted DROP COLUMN overlay; ALTER TABLE painted DROP COLUMN light;")
    old.execute("ALTER TABLE painted DROP COLUMN picture_area")
    old.execute("ALTER TABLE estimates DROP COLUMN focal_log_deviation")
    old.execute("ALTER TABLE frames DROP COLUMN vehicle")
    old.executescript("DROP TABLE covered; DROP TABLE recorded;")
    old.executescript("ALTER TABLE frames DROP COLUMN sharpness; PRAGMA writable_schema = ON;")
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


# What each version brought, taken away again: statements that make a ledger of the one before out of one of this version.
BEFORE = {
    18: """CREATE TABLE old AS SELECT * FROM cameras; DROP TABLE cameras;
        CREATE TABLE cameras (id INTEGER PRIMARY KEY, width INTEGER NOT NULL, height INTEGER NOT NULL, focal NOT NULL,
            k1 NOT NULL, k2 NOT NULL, shift_x NOT NULL, shift_y NOT NULL,
            UNIQUE (width, height, focal, k1, k2, shift_x, shift_y));
        INSERT INTO cameras SELECT id, width, height, focal, k1, k2, shift_x, shift_y FROM old; DROP TABLE old;""",
    17: "ALTER TABLE painted DROP COLUMN picture_area;",
    16: "ALTER TABLE painted DROP COLUMN light;",
    15: "DROP TABLE recorded;",
    14: "DROP TABLE other_files;",
    13: "ALTER TABLE painted DROP COLUMN overlay;",
    12: "ALTER TABLE estimates DROP COLUMN focal_log_deviation;",
    11: "ALTER TABLE frames DROP COLUMN vehicle;",
    10: "ALTER TABLE frames DROP COLUMN sharpness;",
    9: """PRAGMA writable_schema = ON;
        UPDATE sqlite_schema SET sql = replace(sql, ', ' || char(39) || 'unstitched' || char(39), '') WHERE name = 'frames';
        PRAGMA writable_schema = RESET;""",
    8: "",  # only what is in the columns has changed
    7: "",
    6: """DROP TABLE covered; PRAGMA writable_schema = ON;
        UPDATE sqlite_schema SET sql = replace(sql, char(39) || 'covered' || char(39) || ', ', '') WHERE name = 'frames';
        PRAGMA writable_schema = RESET;""",
    5: "ALTER TABLE painted DROP COLUMN dead_border;",
    4: "ALTER TABLE painted DROP COLUMN vignetting;",
    3: """ALTER TABLE flight DROP COLUMN canvas; ALTER TABLE painted DROP COLUMN display;
        ALTER TABLE painted DROP COLUMN gain;
        ALTER TABLE painted ADD COLUMN gain_b NOT NULL DEFAULT 1.0; ALTER TABLE painted ADD COLUMN gain_g NOT NULL DEFAULT 0.97;
        ALTER TABLE painted ADD COLUMN gain_r NOT NULL DEFAULT 1.03;""",
    2: "ALTER TABLE estimates DROP COLUMN homography;",
}


def a_ledger_of(version: int, path: Path) -> None:
    """A ledger with a row in every table that this version has, as that version wrote it."""
    with Ledger(path) as ledger:
        ledger.begin_flight(FlightRecord(name="old", started_utc=1.0))
        ledger.record_island(0)
        ledger.record_frame(a_frame("a.jpg"))
        ledger.settle_frame("a.jpg", FrameState.PLACED)
        ledger.settle_event(ledger.record_event(an_event()), EventState.MATCHED, frame="a.jpg")
        ledger.record_estimates([an_estimate(Pose(1.0, 2.0, 0.5))])
        ledger.record_painted(replace(a_painted(), vignetting=FLAT, light=None, dead=NO_BORDER, still=None, area=None))
        ledger.record_notice(Notice(source="test", level="info", text="told"), 1.0)
    old = sqlite3.connect(path)
    for later in range(VERSION, version, -1):
        old.executescript(f"{BEFORE[later]} PRAGMA user_version = {later - 1};")
    old.close()


def columns_of(path: Path) -> dict[str, set[str]]:
    """The columns of each table."""
    connection = sqlite3.connect(path)
    tables = [row[0] for row in connection.execute("SELECT name FROM sqlite_schema WHERE type = 'table'")]
    columns = {table: {row[1] for row in connection.execute(f"PRAGMA table_info({table})")} for table in tables}
    connection.close()
    return columns


@pytest.mark.parametrize("read_only", [True, False])
@pytest.mark.parametrize("version", range(1, VERSION))
def test_a_ledger_of_each_earlier_version_is_read_and_migrated(tmp_path: Path, version: int, read_only: bool) -> None:
    path = tmp_path / "flight.sqlite"
    a_ledger_of(version, path)
    with Ledger(path, read_only=read_only) as ledger:
        assert sure(ledger.flight()).name == "old"
        assert [(frame.name, frame.state, frame.had_event) for frame in ledger.frames()] == [("a.jpg", "placed", True)]
        assert ledger.estimates() == [an_estimate(Pose(1.0, 2.0, 0.5))]
        assert ledger.painted(0) == [
            replace(a_painted(), vignetting=FLAT, light=None, dead=NO_BORDER, still=None, area=None)
        ]
        assert [notice.text for notice in ledger.notices()] == ["told"]
        assert ledger.rows("PRAGMA foreign_key_check") == []
        assert ledger.rows("PRAGMA user_version")[0][0] == (version if read_only else VERSION)
    if not read_only:
        connect(tmp_path / "new.sqlite").close()
        assert columns_of(path) == columns_of(tmp_path / "new.sqlite")


def test_there_is_a_migration_from_each_earlier_version() -> None:
    assert list(MIGRATIONS) == [version - 1 for version in sorted(BEFORE)] == list(range(1, VERSION))


def test_every_command_that_opens_a_ledger_refuses_a_newer_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(cli, "_end_on_signals", lambda stop, hurry: None)  # they are pytest's here
    flight = tmp_path / "mosaic"
    flight.mkdir()
    a_ledger_of(VERSION, flight / "flight.sqlite")
    newer = sqlite3.connect(flight / "flight.sqlite")
    newer.execute(f"PRAGMA user_version = {VERSION + 1}")
    newer.close()
    island = {"id": 0, "frames": 1, "bounds": [0, 0, 9, 9], "minzoom": 16, "maxzoom": 16}
    (flight / "mosaic.json").write_text(json.dumps({"islands": [island]}))
    live = ("--mavlink", f"udp:127.0.0.1:{free_port()}", "--no-http")
    exports = (("export", "mosaic", "--format", kind) for kind in ("tiff", "placements"))
    for words in ((*live, "--resume"), *exports, ("check", "mosaic"), ("check", "mosaic", "--repair")):
        assert cli.main(words) == 2
        said = capsys.readouterr().err
        assert f"was written by a newer gcs-mosaic (ledger version {VERSION + 1}" in said, (words, said)
        assert said.count("\n") == 1


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
