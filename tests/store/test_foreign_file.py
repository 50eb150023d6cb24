"""Ledgers that somebody else has made are refused in a sentence, at once, before anything of them is computed."""

from __future__ import annotations

import sqlite3
import sys
import time
from contextlib import closing
from pathlib import Path

import pytest

from gcs_mosaic.errors import UsageError
from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.foreign_file import MOST_STEPS, ForeignFile, refuse_strange_files
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.records import FlightRecord
from gcs_mosaic.store.schema import connect, connect_for_reading
from tests.factories import frame
from tests.strangers import ENDLESS, Trick, deleting_journal, ledger, linked, sparse, view_of


@pytest.fixture
def flight(tmp_path: Path) -> Path:
    path = tmp_path / "flight"
    path.mkdir()
    (tmp_path / "outside").mkdir()
    (tmp_path / "outside" / "secret.txt").write_text("precious")
    with Ledger(path / LEDGER_NAME) as made:
        made.begin_flight(FlightRecord(name="flight", started_utc=1.0))
        made.record_frame(frame("a.jpg"))
    return path


TRICKS: dict[str, tuple[Trick, str]] = {
    "a view of frames": (view_of("frames"), "has a view 'frames'"),
    "a view of the flight": (view_of("flight"), "has a view 'flight'"),
    "a trigger": (
        ledger(
            f"CREATE TRIGGER t AFTER UPDATE ON frames BEGIN DELETE FROM frames WHERE id IN ({ENDLESS} SELECT i FROM n); END"
        ),
        "has a trigger 't'",
    ),
    "a virtual table": (ledger("CREATE VIRTUAL TABLE v USING fts5 (a)"), "has a table 'v'"),
    "a computed column": (
        ledger("ALTER TABLE frames ADD COLUMN c AS (hex(zeroblob(9)))"),
        "computes columns of frames",
    ),
    "another schema": (ledger("DROP TABLE painted", "CREATE TABLE painted (a)"), "lacks camera, .* of painted"),
    "no table": (ledger("DROP TABLE painted"), "lacks camera, .* of painted"),
    "a link": (linked(LEDGER_NAME, "secret.txt"), "is a link, which is not followed"),
    "a link that leads nowhere": (linked(f"{LEDGER_NAME}-wal", "new"), "is a link, which is not followed"),
    "nothing but holes": (lambda flight, _: sparse(flight / LEDGER_NAME), "which no file of gcs-mosaic has"),
    "a journal that deletes": (deleting_journal(LEDGER_NAME), "names files elsewhere"),
}


@pytest.mark.parametrize("how", [connect, connect_for_reading])
@pytest.mark.parametrize("trick", TRICKS)
def test_a_ledger_of_a_stranger_is_refused_at_once(flight: Path, trick: str, how: object) -> None:
    make, said = TRICKS[trick]
    make(flight, flight.parent / "outside")
    start = time.monotonic()
    with pytest.raises(UsageError, match=said):
        (connect if how is connect else connect_for_reading)(flight / LEDGER_NAME)
    assert time.monotonic() - start < 2.0
    assert (flight.parent / "outside" / "secret.txt").read_text() == "precious"
    assert [path.name for path in (flight.parent / "outside").iterdir()] == ["secret.txt"]


@pytest.mark.parametrize(
    "statement",
    [
        "UPDATE frames SET state = 'strange'",
        "UPDATE flight SET started_utc = 'x'",
        "UPDATE flight SET canvas = '[[[1]]]'",
        "UPDATE frames SET name = 7",
    ],
)
def test_values_of_other_kinds_are_a_sentence(flight: Path, statement: str) -> None:
    ledger(statement)(flight, flight)
    with (
        Ledger(flight / LEDGER_NAME, read_only=True) as opened,
        pytest.raises(UsageError, match="holds what no ledger has"),
    ):
        opened.flight() and opened.frames()


def test_a_statement_ends_within_its_bounds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Should a schema compute for ever all the same."""
    monkeypatch.setattr("gcs_mosaic.store.foreign_file.MOST_STEPS", 5)
    assert MOST_STEPS > 5
    with closing(sqlite3.connect(tmp_path / "file", factory=ForeignFile)) as file:
        with pytest.raises(sqlite3.OperationalError, match="interrupted"):
            file.execute(f"{ENDLESS} SELECT count(*) FROM n").fetchone()
        with pytest.raises(sqlite3.DataError, match="too big"):
            file.execute("SELECT zeroblob(900000000)").fetchone()
        assert file.execute("SELECT 1").fetchone() == (1,)


def test_rows_that_take_too_long_are_a_sentence(flight: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gcs_mosaic.store.foreign_file.MOST_STEPS", 5)
    with Ledger(flight / LEDGER_NAME, read_only=True) as opened, pytest.raises(UsageError, match="cannot be read"):
        opened.rows(f"{ENDLESS} SELECT count(*) FROM n")


@pytest.mark.skipif(sys.platform != "linux", reason="whether a file has holes is not told everywhere")
@pytest.mark.parametrize(("size", "refused"), [(64_000_000, False), (64_000_001, True)])
@pytest.mark.parametrize("end", ["", "-wal"])
def test_a_file_of_holes_is_no_ledger(tmp_path: Path, size: int, refused: bool, end: str) -> None:
    path = tmp_path / "flight.sqlite"
    with path.with_name(f"{path.name}{end}").open("wb") as file:
        file.truncate(size)
    if not refused:
        refuse_strange_files(path)
        return
    with pytest.raises(UsageError, match=r"has 0\.1 GB, which no file of gcs-mosaic has"):
        refuse_strange_files(path)
