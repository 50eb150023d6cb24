"""What can still be read of a damaged ledger goes into a new one; the damaged one is set aside."""

from __future__ import annotations

import logging
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

from gcs_mosaic.store import inside
from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.foreign_file import ForeignFile, refuse_strange_files
from gcs_mosaic.store.ledger import Ledger

logger = logging.getLogger(__name__)

TABLES = (
    "flight",
    "frames",
    "events",
    "islands",
    "cameras",
    "painted",
    "estimates",
    "covered",
    "other_files",
    "recorded",
    "notices",
)
SUFFIXES = ("", "-wal", "-shm")


def salvage(flight: Path) -> str:
    """Set the ledger aside and make a new one of what can be read of it; returns what was done."""
    aside = _set_aside(flight)
    with Ledger(flight / LEDGER_NAME) as ledger:
        rows = _copy_rows(aside, flight / LEDGER_NAME) if aside else {}
        frames = ledger.accounts().frames.placed
    saved = ", ".join(f"{count} of {table}" for table, count in rows.items() if count) or "none"
    where = f"the damaged ledger is kept as {aside.name}; " if aside else ""
    again = f": gcs-mosaic stitch {flight / 'frames'} makes the map anew" if not frames else ""
    return f"{where}rows that could be read of it: {saved}{again}"


def _set_aside(flight: Path) -> Path | None:
    """Rename the ledger and its log; None if there is none."""
    path = flight / LEDGER_NAME
    if not inside.exists(path, flight):
        return None
    number = 1
    while inside.exists(aside := flight / f"{LEDGER_NAME}.damaged-{number}", flight):
        number += 1
    for suffix in SUFFIXES:  # SQLite looks for the log beside the file, under its name
        beside = path.with_name(path.name + suffix)
        if inside.exists(beside, flight):
            inside.move(beside, aside.with_name(aside.name + suffix), flight)
    return aside


def _copy_rows(damaged: Path, new: Path) -> dict[str, int]:
    """Copy table by table, each from its beginning and from its end until the damage; returns the numbers of rows."""
    refuse_strange_files(damaged)
    with closing(sqlite3.connect(damaged, factory=ForeignFile)) as source, closing(sqlite3.connect(new)) as target:
        counts = {table: _copy_table(table, source, target) for table in TABLES}
        target.commit()
    return counts


def _copy_table(table: str, source: sqlite3.Connection, target: sqlite3.Connection) -> int:
    known = [row[1] for row in target.execute(f"PRAGMA table_info({table})")]
    try:
        if source.execute("SELECT 1 FROM sqlite_schema WHERE name = ? AND type != 'table'", (table,)).fetchone():
            return 0  # a view in its place: none of ours
        there = [row[1] for row in source.execute(f"PRAGMA table_info({table})")]
    except sqlite3.DatabaseError:
        logger.warning("nothing of the table %s can be read", table, exc_info=True)
        return 0
    columns = [f'"{column}"' for column in there if column in known]
    if not columns:
        return 0
    insert = f"INSERT OR IGNORE INTO {table} ({', '.join(columns)}) VALUES ({', '.join('?' * len(columns))})"
    for order in ("ASC", "DESC"):
        select = f"SELECT {', '.join(columns)} FROM {table} NOT INDEXED ORDER BY rowid {order}"
        for row in _until_damage(source, select):
            target.execute(insert, row)
    return int(target.execute(f"SELECT count(*) FROM {table}").fetchone()[0])


def _until_damage(source: sqlite3.Connection, select: str) -> Iterator[tuple[object, ...]]:
    try:
        yield from source.execute(select)
    except sqlite3.DatabaseError:
        logger.info("no more can be read this way: %s", select, exc_info=True)
