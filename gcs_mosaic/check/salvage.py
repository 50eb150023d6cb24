"""What can still be read of a damaged ledger goes into a new one; the damaged one is set aside."""

from __future__ import annotations

import logging
import sqlite3
from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from gcs_mosaic.store import inside
from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.foreign_file import ForeignFile, refuse_strange_files
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.typed import typed

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
LOST = {"events": "triggers and their positions"}  # what nothing else in the folder tells again
SUFFIXES = ("", "-wal", "-shm")


class Read(NamedTuple):
    """The numbers of rows by table, and the tables of which some could not be read."""

    counts: Mapping[str, int]
    damaged: frozenset[str]


@dataclass(frozen=True, slots=True)
class Salvaged:
    """What was done, in a sentence; `unread`: what could not be read, in words, empty if all could."""

    said: str
    unread: str = ""


def salvage(flight: Path) -> Salvaged:
    """Set the ledger aside and make a new one of what can be read of it."""
    aside = _set_aside(flight)
    with Ledger(flight / LEDGER_NAME):
        read = _copy_rows(aside, flight / LEDGER_NAME) if aside else Read({}, frozenset())
    with Ledger(flight / LEDGER_NAME, read_only=True) as ledger:
        placed = ledger.accounts().frames.placed
    counts = ", ".join(f"{table} {count}" for table, count in read.counts.items() if count)
    where = f"the damaged ledger is kept as {aside.name}; read of it: " if aside else "there was no ledger; "
    unread = _unread_words(read) if counts else f"nothing could be read: {LOST['events']} are lost"
    again = "" if placed else f": gcs-mosaic stitch {typed(flight / 'frames')} makes the map anew"
    return Salvaged(f"{where}{'; '.join(part for part in (counts, unread) if part)}{again}", unread)


def _unread_words(read: Read) -> str:
    """The kinds of rows that could not be read, or not all of them, and what that means."""
    words = []
    for tables, how, lost in (
        ([one for one in TABLES if one in read.damaged and not read.counts[one]], "could not be read", "are lost"),
        (
            [one for one in TABLES if one in read.damaged and read.counts[one]],
            "could be read in part only",
            "may be lost",
        ),
    ):
        means = ", ".join(f"{LOST[one]} {lost}" for one in tables if one in LOST)
        words += [f"{', '.join(tables)} {how}{': ' * bool(means)}{means}"] if tables else []
    return "; ".join(words)


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


def _copy_rows(damaged: Path, new: Path) -> Read:
    """Copy table by table, each from its beginning and from its end until the damage."""
    refuse_strange_files(damaged)
    with closing(sqlite3.connect(damaged, factory=ForeignFile)) as source, closing(sqlite3.connect(new)) as target:
        whole = {table: _copy_table(table, source, target) for table in TABLES}
        counts = {table: int(target.execute(f"SELECT count(*) FROM {table}").fetchone()[0]) for table in TABLES}
        target.commit()
    return Read(counts, frozenset(table for table in TABLES if not whole[table]))


def _copy_table(table: str, source: sqlite3.Connection, target: sqlite3.Connection) -> bool:
    """Whether all of it could be read."""
    known = [row[1] for row in target.execute(f"PRAGMA table_info({table})")]
    try:
        if source.execute("SELECT 1 FROM sqlite_schema WHERE name = ? AND type != 'table'", (table,)).fetchone():
            return True  # a view in its place: none of ours
        there = [row[1] for row in source.execute(f"PRAGMA table_info({table})")]
    except sqlite3.DatabaseError:
        logger.warning("nothing of the table %s can be read", table, exc_info=True)
        return False
    columns = [f'"{column}"' for column in there if column in known]
    if not columns:
        return True
    insert = f"INSERT OR IGNORE INTO {table} ({', '.join(columns)}) VALUES ({', '.join('?' * len(columns))})"
    for order in ("ASC", "DESC"):
        select = f"SELECT {', '.join(columns)} FROM {table} NOT INDEXED ORDER BY rowid {order}"
        try:
            for row in source.execute(select):
                target.execute(insert, row)
        except sqlite3.DatabaseError:
            logger.info("no more can be read this way: %s", select, exc_info=True)
        else:
            return True
    return False
