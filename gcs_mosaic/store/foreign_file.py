"""Opening an SQLite file that somebody else may have made: what it may be, and what reading it may cost.

A schema is a program: views, triggers and generated columns are computed when a table is read, and a rollback journal names
files that SQLite deletes. None of ours has any of that, so a file that has is refused before anything of it is read.
"""

from __future__ import annotations

import os
import sqlite3
import stat
from collections.abc import Iterable
from functools import lru_cache
from pathlib import Path
from typing import Any

from gcs_mosaic.errors import UsageError
from gcs_mosaic.store import inside

COMPANIONS = ("", "-wal", "-shm", "-journal")  # of a file of SQLite, beside it
LARGEST_FILE = 4 << 30  # bytes; a copy of it is held in memory. 100,000 frames take less than one GB
LARGEST_VALUE = 64 << 20  # bytes of one value; ours have some kilobytes
STEPS = 1_000_000  # of SQLite's machine, after which it asks whether to go on
MOST_STEPS = 1_000  # such spans for one statement, some ten seconds; those for 100,000 frames take less than one
JOURNAL_END = bytes.fromhex("d9d505f920a163d7")  # after the name of another journal, which SQLite may delete


class ForeignFile(sqlite3.Connection):
    """A connection whose statements each end within bounds of computing and of memory."""

    def __init__(self, *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **named)
        self._spans = 0
        super().execute("PRAGMA trusted_schema = OFF")
        self.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, LARGEST_VALUE)
        self.set_progress_handler(self._is_too_long, STEPS)

    def execute(self, *arguments: Any) -> sqlite3.Cursor:
        self._spans = 0
        return super().execute(*arguments)

    def _is_too_long(self) -> int:
        self._spans += 1
        return int(self._spans > MOST_STEPS)


def refuse_strange_files(path: Path) -> None:
    """Raises UsageError where the file, or one that SQLite keeps beside it, is no plain file, or larger than any of ours. What is
    not there is right."""
    for one in (path.with_name(f"{path.name}{end}") for end in COMPANIONS):
        try:
            found = one.lstat()
        except OSError:
            continue
        if not stat.S_ISREG(found.st_mode):
            what = "a link" if stat.S_ISLNK(found.st_mode) else "no plain file"
            raise UsageError(f"{one} is {what}, which is not followed: put the file itself there, or move it away")
        if found.st_size > LARGEST_FILE or inside.is_mostly_holes(found):
            size = f"{found.st_size / 1e9:.1f} GB"
            raise UsageError(f"{one} has {size}, which no file of gcs-mosaic has: move it away, or name another folder")
    journal = path.with_name(f"{path.name}-journal")
    if _names_another(journal):
        raise UsageError(f"{journal} is not of gcs-mosaic, as it names files elsewhere: move it away")


def refuse_strange_schema(connection: sqlite3.Connection, path: Path, tables: str, *, whole: bool) -> None:
    """Raises UsageError for a schema that computes, or is none of ours. `tables`: the statements that make it; `whole`: all
    their columns must be there, as in a file of the present version."""
    for kind, name, sql in connection.execute("SELECT type, name, sql FROM sqlite_schema"):
        computes = kind in ("view", "trigger") or str(sql).lstrip()[:14].upper() == "CREATE VIRTUAL"
        if computes or not isinstance(name, str):
            what = f"a {kind} {str(name)[:40]!r}"
            raise UsageError(f"{path} has {what}, which no file of gcs-mosaic has: it is not read, take that out of it")
    for table, columns in _columns_of(tables).items():
        found = _columns(connection, table)
        if any(hidden for _, hidden in found):
            raise UsageError(f"{path} computes columns of {table}, which no file of gcs-mosaic does: it is not read")
        missing = columns - {name for name, _ in found}
        if missing and whole:
            raise UsageError(
                f"{path} lacks {', '.join(sorted(missing))} of {table}: it is not read, see gcs-mosaic check"
            )


@lru_cache(8)
def _columns_of(tables: str) -> dict[str, frozenset[str]]:
    memory = sqlite3.connect(":memory:")
    try:
        memory.executescript(tables)
        names = [row[0] for row in memory.execute("SELECT name FROM sqlite_schema WHERE type = 'table'")]
        ours = [name for name in names if not name.startswith("sqlite_")]
        return {name: frozenset(column for column, _ in _columns(memory, name)) for name in ours}
    finally:
        memory.close()


def _columns(connection: sqlite3.Connection, table: str) -> list[tuple[str, int]]:
    """Names, and whether the value is hidden or computed."""
    rows: Iterable[Any] = connection.execute(f"PRAGMA table_xinfo({table})")
    return [(str(row[1]), int(row[6])) for row in rows]


def _names_another(journal: Path) -> bool:
    """Whether a rollback journal names that of a transaction over several files: ours never span several."""
    try:
        with inside.reading(journal, journal.parent) as file:
            file.seek(max(0, file.seek(0, os.SEEK_END) - len(JOURNAL_END)))
            return file.read() == JOURNAL_END
    except OSError:
        return False
