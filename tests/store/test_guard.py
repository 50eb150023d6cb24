"""The output folder goes and comes back in every way: what is this flight's is written anew, what is another's is left."""

from __future__ import annotations

import os
import shutil
import sqlite3
import subprocess
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from gcs_mosaic.messages import Notice
from gcs_mosaic.store.disk import CannotWrite
from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.guard import FolderGuard
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.lock import LOCK_NAME, try_lock
from gcs_mosaic.store.records import FlightRecord
from tests.store.ledger_parts import a_frame, an_event
from tests.sure import sure


class Guarded:
    """A folder with a ledger that holds a little, and its guard."""

    def __init__(self, out: Path) -> None:
        out.mkdir(exist_ok=True)
        self.out, self.path = out, out / LEDGER_NAME
        self.lock = sure(try_lock(out))
        self.ledger = Ledger(self.path)
        self.ledger.begin_flight(FlightRecord(name="f", started_utc=1.7e9))
        self.ledger.record_event(an_event())
        self.guard = FolderGuard(out, self.lock, self.ledger)

    def assert_whole(self) -> None:
        """The file holds everything, what comes now too, and the folder is locked."""
        assert self.guard.ensure() is None
        self.ledger.record_frame(a_frame())
        with Ledger(self.path, read_only=True) as ledger:
            assert [frame.name for frame in ledger.frames()] == ["a.jpg"]
            assert len(ledger.events()) == 1
        assert try_lock(self.out) is None

    def close(self) -> None:
        self.ledger.close()
        self.lock.release()


@pytest.fixture
def guarded(tmp_path: Path) -> Iterator[Guarded]:
    with closing(Guarded(tmp_path / "out")) as one:
        yield one


def deleted(out: Path) -> None:
    shutil.rmtree(out)


def emptied(out: Path) -> None:
    for path in out.iterdir():
        path.unlink()


def replaced(out: Path) -> None:
    out.rename(out.with_name("away"))
    out.mkdir()


def without_ledger(out: Path) -> None:
    (out / LEDGER_NAME).unlink()


def without_lock(out: Path) -> None:
    (out / LOCK_NAME).unlink()


def older(out: Path) -> None:
    shutil.copytree(out, out.with_name("copy"))
    out.rename(out.with_name("away"))
    out.with_name("copy").rename(out)


@pytest.mark.parametrize("loss", [deleted, emptied, replaced, without_ledger, without_lock, older])
def test_what_was_this_flights_is_written_anew(guarded: Guarded, loss: Callable[[Path], None]) -> None:
    assert guarded.guard.ensure() is None
    loss(guarded.out)
    taken = sure(guarded.guard.ensure())
    assert taken.everything
    guarded.assert_whole()


def test_a_folder_that_was_moved_away_is_waited_for(guarded: Guarded) -> None:
    away = guarded.out.rename(guarded.out.with_name("away"))
    with pytest.raises(CannotWrite, match="the folder is gone; put it back"):
        guarded.guard.ensure()
    assert not guarded.out.exists()
    away.rename(guarded.out)
    guarded.assert_whole()


def test_another_flight_in_its_place_is_left_as_it_is(guarded: Guarded) -> None:
    replaced(guarded.out)
    with Ledger(guarded.path) as other:
        other.begin_flight(FlightRecord(name="f", started_utc=1.8e9))
    before = {path: path.read_bytes() for path in guarded.out.iterdir()}
    with pytest.raises(CannotWrite, match="is not this flight's, and left as it is: move it away"):
        guarded.guard.ensure()
    assert {path: path.read_bytes() for path in guarded.out.iterdir() if "sqlite-" not in path.name} == before
    emptied(guarded.out)
    assert guarded.guard.ensure() is not None
    guarded.assert_whole()


def test_a_ledger_of_another_that_was_copied_over_ours_is_left_as_it_is(guarded: Guarded, tmp_path: Path) -> None:
    with Ledger(tmp_path / "other.sqlite") as other:
        other.begin_flight(FlightRecord(name="other", started_utc=1.8e9))
    (tmp_path / "other.sqlite").replace(guarded.path)
    with pytest.raises(CannotWrite, match="is not this flight's"):
        guarded.guard.ensure()


def test_what_somebody_else_has_put_there_is_left_as_it_is(guarded: Guarded) -> None:
    replaced(guarded.out)
    (guarded.out / "mosaic.json").write_text("{}")
    os.utime(guarded.out / "mosaic.json", (1.7e9, 1.7e9))
    with pytest.raises(CannotWrite, match=r"it has a mosaic\.json of its own"):
        guarded.guard.ensure()
    assert os.listdir(guarded.out) == ["mosaic.json"]  # noqa: PTH208


def test_what_this_flight_wrote_there_before_it_was_noticed_is_no_obstacle(guarded: Guarded) -> None:
    replaced(guarded.out)
    (guarded.out / "checkpoint").write_text("of this flight")
    assert guarded.guard.ensure() is not None
    guarded.assert_whole()


def test_a_folder_that_another_program_writes_is_waited_for(guarded: Guarded) -> None:
    replaced(guarded.out)
    theirs = sure(try_lock(guarded.out))
    with pytest.raises(CannotWrite, match="is being written by another gcs-mosaic"):
        guarded.guard.ensure()
    theirs.release()
    assert guarded.guard.ensure() is not None
    guarded.assert_whole()


@pytest.mark.parametrize(("folder", "said"), [(".", "its mount is gone"), ("out", "the folder is gone")])
def test_a_disk_that_is_lost_is_waited_for_nothing_is_written_below_it_and_another_one_will_do(
    tiny_disk: Path, folder: str, said: str
) -> None:
    with closing(Guarded(tiny_disk / folder)) as guarded:
        subprocess.run(["umount", "--lazy", tiny_disk], check=True)
        try:
            with pytest.raises(CannotWrite, match=said):
                guarded.guard.ensure()
            assert not list(tiny_disk.iterdir())
        finally:
            subprocess.run(["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", tiny_disk], check=True)
        assert guarded.guard.ensure() is not None
        guarded.assert_whole()


def test_a_damaged_ledger_is_written_anew(guarded: Guarded) -> None:
    with guarded.path.open("r+b") as file:
        file.write(bytes(8192))
    guarded.path.with_name(f"{LEDGER_NAME}-wal").write_bytes(b"")
    guarded.ledger.verify()
    assert not sure(guarded.guard.ensure()).everything
    guarded.assert_whole()


def test_a_log_that_is_left_is_not_taken_for_the_new_files(guarded: Guarded, tmp_path: Path) -> None:
    with Ledger(tmp_path / "other.sqlite") as other:
        other.begin_flight(FlightRecord(name="other", started_utc=1.8e9))
        guarded.path.unlink()
        shutil.copy(tmp_path / "other.sqlite-wal", guarded.path.with_name(f"{LEDGER_NAME}-wal"))
    assert guarded.guard.ensure() is not None
    with Ledger(guarded.path, read_only=True) as ledger:
        assert sure(ledger.flight()).name == "f"
    guarded.assert_whole()


def test_a_whole_ledger_is_left_as_it_is(guarded: Guarded) -> None:
    guarded.ledger.verify()
    assert guarded.guard.ensure() is None


def test_what_is_rolled_back_in_the_file_is_in_memory_too(guarded: Guarded) -> None:
    with pytest.raises(sqlite3.IntegrityError), guarded.ledger.transaction():  # noqa: PT012 -- of a transaction's two
        guarded.ledger.record_frame(a_frame())
        guarded.ledger.record_frame(a_frame())
    assert guarded.ledger.frames() == []
    guarded.ledger.verify()
    assert guarded.guard.ensure() is None


class Unsure:
    """A connection whose commits are done, but told as failed."""

    def __init__(self, connection: sqlite3.Connection) -> None:
        self._connection = connection

    def __getattr__(self, name: str) -> object:
        return getattr(self._connection, name)

    def execute(self, sql: str, values: tuple[Any, ...] = ()) -> sqlite3.Cursor:
        done = self._connection.execute(sql, values)
        if sql == "COMMIT":
            error = sqlite3.OperationalError("disk I/O error")
            error.sqlite_errorcode = sqlite3.SQLITE_IOERR_FSYNC
            raise error
        return done


def test_a_commit_in_doubt_is_neither_lost_nor_done_twice(guarded: Guarded) -> None:
    guarded.ledger._file = Unsure(sure(guarded.ledger._file))  # type: ignore[assignment]
    with pytest.raises(CannotWrite, match="disk I/O error"):
        guarded.ledger.record_notice(Notice(source="s", level="info", text="t"), 0.0)
    assert not sure(guarded.guard.ensure()).everything
    guarded.ledger.record_notice(Notice(source="s", level="info", text="t"), 0.0)
    with Ledger(guarded.path, read_only=True) as ledger:
        assert len(ledger.notices()) == 1
    guarded.assert_whole()


def test_a_ledger_that_another_program_has_locked_is_told_and_can_be_read(guarded: Guarded) -> None:
    with closing(sqlite3.connect(guarded.path, isolation_level=None)) as other:
        sure(guarded.ledger._file).execute("PRAGMA busy_timeout = 10")
        other.execute("BEGIN EXCLUSIVE")
        with pytest.raises(CannotWrite, match="is locked by another program: close it there"):
            guarded.ledger.record_frame(a_frame())
        assert len(guarded.ledger.events()) == 1
        assert guarded.guard.ensure() is None
    guarded.assert_whole()
