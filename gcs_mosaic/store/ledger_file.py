"""The ledger's SQLite file, with a copy in memory from which the file is written anew if it is lost or damaged.

A folder may be deleted, a mount may be lost, a disk may fail after SQLite has been told that a transaction is committed. The
copy has every committed transaction and nothing else, so no recovery has to guess what the file still holds; and what is
read never waits for the disk, nor for another program that has locked the file.
"""

from __future__ import annotations

import logging
import sqlite3
import zlib
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import ClassVar, Self, TypeVar

from gcs_mosaic.errors import UsageError
from gcs_mosaic.store import inside
from gcs_mosaic.store.disk import CannotWrite, is_disk_full, sync_file, sync_folder, telling_disk_full
from gcs_mosaic.store.foreign_file import COMPANIONS, ForeignFile
from gcs_mosaic.store.schema import LEDGER, DamagedLedger, FileSchema, connect, connect_for_reading

logger = logging.getLogger(__name__)

Made = TypeVar("Made")

# Primary result codes after which it is unknown what the file holds.
DAMAGE = (
    *(sqlite3.SQLITE_IOERR, sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB),
    *(sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_READONLY, sqlite3.SQLITE_PROTOCOL),
)
BUSY = (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED)


class LedgerFile:
    """One SQLite file that holds a flight. Use it only from the thread that opened it."""

    schema: ClassVar[FileSchema] = LEDGER

    def __init__(self, path: Path, *, read_only: bool = False) -> None:
        """Open the ledger at `path`; create it if missing (unless `read_only`). Raises UsageError and DiskFull."""
        self.path = path
        self.damaged = False  # the file may not hold what was committed: see `write_anew`
        opened = connect_for_reading(path, self.schema) if read_only else connect(path, self.schema)
        self._file: sqlite3.Connection | None = opened
        self._memory = opened if read_only else held_in_memory(opened)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        self._memory.close()
        if self._file is not None:
            self._file.close()

    def make_durable(self) -> None:
        """Sync all committed changes to disk; callable from any thread. Raises DiskFull and OSError.

        With `synchronous = NORMAL` SQLite itself syncs only at a checkpoint of its write-ahead log.
        """
        log = self.path.with_name(f"{self.path.name}-wal")
        try:
            with telling_disk_full(self.path), suppress(FileNotFoundError):  # without a log all is in the main file
                sync_file(log)
        except OSError:
            self.damaged = True  # after a failed sync the system may have dropped what it could not write
            raise

    def write_anew(self) -> None:
        """Replace the file by one that holds what is in memory. Raises DiskFull and OSError, and may be repeated."""
        if self._file is not None:
            self._file.close()  # a file that is no longer at its path is left as it is by SQLite
            self._file = None
        part = self.path.with_name(f".{self.path.name}.part")
        with self._watched():
            _remove(part, *_companions(part))
            part.touch()  # tells why, if that is impossible, in better words than SQLite
            with closing(sqlite3.connect(part, isolation_level=None)) as new:  # it is made here, of what is ours
                self._memory.backup(new)
            sync_file(part)
            _remove(*_companions(self.path))  # a log that is left would be taken for the new file's
            inside.move(part, self.path, part.parent)
            sync_folder(self.path.parent)
            self._file = connect(self.path, self.schema)
        self.damaged = False

    def verify(self) -> None:
        """Read the whole file as others do; note if it does not hold what is in memory: something else may have written to it."""
        try:
            with closing(connect_for_reading(self.path, self.schema)) as found:
                whole = found.execute("PRAGMA quick_check").fetchone()[0] == "ok"
                self.damaged |= not whole or _counts(found) != _counts(self._memory)
        except (sqlite3.DatabaseError, UsageError):
            logger.warning("%s cannot be read", self.path, exc_info=True)
            self.damaged = True

    @contextmanager
    def transaction(self) -> Iterator[None]:
        """Commit all changes inside together, or none. Nested transactions are part of the outer one."""
        if self._memory.in_transaction:
            yield
            return
        with self._watched():
            file = self._opened()
            try:
                file.execute("BEGIN IMMEDIATE")
                self._memory.execute("BEGIN IMMEDIATE")
                yield
                file.execute("COMMIT")
                self._memory.execute("COMMIT")
            finally:
                # SQLite rolls back by itself on some errors (a full disk), not on others.
                for one in (self._memory, file):
                    if one.in_transaction:
                        one.execute("ROLLBACK")

    def write(self, sql: str, *values: object) -> int:
        """Run one statement; returns the id of the inserted row."""
        return self._run(sql, values).lastrowid or 0

    def changed(self, sql: str, *values: object) -> int:
        """Run one statement; returns the number of changed rows."""
        return self._run(sql, values).rowcount

    def update(self, sql: str, *values: object) -> None:
        """Change exactly one row, identified by the last value. Raises LookupError if there is none."""
        if self.changed(sql, *values) != 1:
            raise LookupError(f"nothing of that name in {self.path}: {values[-1]!r}")

    def rows(self, sql: str, *values: object) -> list[sqlite3.Row]:
        """Raises DamagedLedger for a file that breaks off, or takes too long to read."""
        try:
            return self._memory.execute(sql, values).fetchall()
        except sqlite3.ProgrammingError:  # a fault of ours
            raise
        except sqlite3.DatabaseError as error:
            raise DamagedLedger(f"{self.path} cannot be read ({error}): see gcs-mosaic check") from error

    def made(self, make: Callable[[sqlite3.Row], Made], rows: Iterable[sqlite3.Row]) -> list[Made]:
        """A record of each row. Raises DamagedLedger for values that no ledger of ours has."""
        try:
            return [make(row) for row in rows]
        except (
            TypeError,
            ValueError,
            LookupError,
            ArithmeticError,
            AttributeError,
            RecursionError,
            zlib.error,
        ) as error:
            raise DamagedLedger(f"{self.path} holds what no {self.schema.noun} has ({error!r})") from error

    def _run(self, sql: str, values: tuple[object, ...]) -> sqlite3.Cursor:
        with self.transaction():
            self._opened().execute(sql, values)
            return self._memory.execute(sql, values)

    def _opened(self) -> sqlite3.Connection:
        if self._file is None:
            raise CannotWrite(f"{self.path} is not there")
        return self._file

    @contextmanager
    def _watched(self) -> Iterator[None]:
        """Note what leaves the file in doubt. Raises DiskFull; CannotWrite for a file in doubt or locked; other errors as
        they are."""
        try:
            with telling_disk_full(self.path):
                yield
        except sqlite3.DatabaseError as error:
            if code(error) in BUSY:
                text = f"{self.path} is locked by another program: close it there, then it goes on"
                raise CannotWrite(text) from error
            if code(error) not in DAMAGE:
                raise
            self.damaged = True
            raise CannotWrite(f"{self.path} cannot be written ({error})") from error


def held_in_memory(file: sqlite3.Connection) -> sqlite3.Connection:
    """A copy of a database."""
    memory = sqlite3.connect(":memory:", isolation_level=None, factory=ForeignFile)
    file.backup(memory)
    memory.row_factory = sqlite3.Row
    memory.execute("PRAGMA foreign_keys = ON")
    return memory


def _counts(database: sqlite3.Connection) -> list[int]:
    tables = database.execute("SELECT name FROM sqlite_schema WHERE type = 'table' ORDER BY name").fetchall()
    return [database.execute(f"SELECT count(*) FROM {name}").fetchone()[0] for (name,) in tables]


def code(error: sqlite3.Error) -> int:
    """SQLite's primary result code; 0 if unknown. A full disk is told apart by `is_disk_full`."""
    assert not is_disk_full(error), "converted before"
    return int(getattr(error, "sqlite_errorcode", 0)) & 0xFF


def _companions(path: Path) -> Iterable[Path]:
    return (path.with_name(f"{path.name}{end}") for end in COMPANIONS if end)


def _remove(*paths: Path) -> None:
    for path in paths:
        inside.remove(path, path.parent)


def flight_at(path: Path) -> tuple[str, float] | None:
    """Name and start of the flight in a ledger; None if there is none. Its main file decides; the log beside it may be left
    from another ledger, and counts only if the main file is still without a flight."""
    for without_log in (True, False):
        with (
            suppress(UsageError, sqlite3.DatabaseError),
            closing(connect_for_reading(path, without_log=without_log)) as found,
        ):
            for row in found.execute("SELECT name, started_utc FROM flight"):
                return str(row["name"]), float(row["started_utc"])
    return None
