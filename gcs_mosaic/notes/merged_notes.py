"""What people had added to several flights, on the map that these were merged into.

Whatever is bound to a frame that has its place there is taken along, with who, when and all that was written: finds, pins and
known distances. What was reviewed, and hints that were dismissed, belong to the maps of those flights, and stay there.
"""

from __future__ import annotations

import logging
import sqlite3
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path

from gcs_mosaic.messages import Notice
from gcs_mosaic.notes.anchors.pins import MOST_PINS, Pins
from gcs_mosaic.notes.anchors.scales import MOST_SCALES
from gcs_mosaic.notes.finds.finds import MOST_FINDS
from gcs_mosaic.notes.ground.binding import Binding, GroundFollower
from gcs_mosaic.notes.ground.places import PLACE_COLUMNS, binding_of, place_row
from gcs_mosaic.notes.storage.book import NotesBook, NotesFile
from gcs_mosaic.store import inside
from gcs_mosaic.store.folder import NOTES_NAME
from gcs_mosaic.views.flight_view import FlightView

logger = logging.getLogger(__name__)

WHO = "merge"
FIND, PIN, DISTANCE = "find", "pin", "known distance"


@dataclass(frozen=True, slots=True)
class NotedFlight:
    """A flight that was merged, and what its frames are called now."""

    path: Path
    name_of: Callable[[str], str]


@dataclass(slots=True)
class _Counts:
    taken: Counter[str]
    left: Counter[str]


def merge_notes(out: Path, flights: Sequence[NotedFlight]) -> Iterator[Notice]:
    """Add the flights' notes to those of the map in `out`, each flight's whole or not at all; says what was done."""
    follower = GroundFollower(FlightView(out))
    for flight in flights:
        if not inside.exists(flight.path / NOTES_NAME, flight.path):
            continue
        try:
            counts = _taken(out, flight, follower)
        except Exception as error:  # a file from elsewhere may hold anything
            logger.warning("the notes of %s were not taken along", flight.path, exc_info=True)
            text = f"{flight.path}: its notes were not taken along ({error}); they are where they were"
            yield Notice(source="merge", level="warning", text=text)
        else:
            yield from _said(flight, counts)


def _taken(out: Path, flight: NotedFlight, follower: GroundFollower) -> _Counts:
    counts = _Counts(Counter(), Counter())
    with NotesFile(flight.path / NOTES_NAME, read_only=True) as old, closing(NotesBook(out)) as book:
        with book.change() as new:
            for kind, table, most in ((FIND, "finds", MOST_FINDS), (PIN, "pins", MOST_PINS)):
                for row in _rows(old, f"SELECT * FROM {table} WHERE deleted = 0 LIMIT {most}", table):
                    place = _place(flight, follower, row)
                    (counts.left if place is None else counts.taken)[kind] += 1
                    if place is not None:
                        _insert(new, table, row, place)
            _take_distances(old, new, flight, follower, counts)
        if any(row["by_positions"] for row in _rows(old, "SELECT by_positions FROM anchoring", "anchoring")):
            Pins(book).ask_for_positions(WHO, asked=True)
    return counts


def _take_distances(
    old: NotesFile, new: NotesFile, flight: NotedFlight, follower: GroundFollower, counts: _Counts
) -> None:
    for row in _rows(old, f"SELECT * FROM scales WHERE deleted = 0 LIMIT {MOST_SCALES}", "scales"):
        ends = old.rows("SELECT * FROM scale_ends WHERE scale = ? ORDER BY end", row["id"])
        places = [_place(flight, follower, end) for end in ends]
        if None in places:
            counts.left[DISTANCE] += 1
            continue
        counts.taken[DISTANCE] += 1
        made = _insert(new, "scales", row)
        for end, place in zip(ends, places, strict=True):
            _insert(new, "scale_ends", end, place, scale=made)


def _place(flight: NotedFlight, follower: GroundFollower, row: sqlite3.Row) -> Binding | None:
    """Where something lies on the merged map; None if it is bound to no frame that has a place there."""
    was = binding_of(row)
    if was.frame is None:
        return None
    here = replace(was, frame=flight.name_of(was.frame))
    now = follower.place(here)
    return None if now.number is None else replace(here, island=now.island, x=now.x, y=now.y)


def _insert(new: NotesFile, table: str, row: sqlite3.Row, place: Binding | None = None, **changed: object) -> int:
    """Write a row with another place, under a number of its own."""
    values = {name: row[name] for name in row.keys() if name not in ("id", "key")} | changed  # noqa: SIM118
    if place is not None:
        values |= dict(zip(PLACE_COLUMNS.split(", "), place_row(place), strict=True))
    return new.write(
        f"INSERT INTO {table} ({', '.join(values)}) VALUES ({', '.join('?' * len(values))})", *values.values()
    )


def _rows(file: NotesFile, query: str, table: str) -> list[sqlite3.Row]:
    """The rows of a table that a file of an earlier version may lack."""
    known = file.rows("SELECT 1 FROM sqlite_schema WHERE name = ?", table)
    return file.rows(query) if known else []


def _said(flight: NotedFlight, counts: _Counts) -> Iterator[Notice]:
    if counts.taken:
        yield Notice(source="merge", level="info", text=f"{flight.path}: {_counted(counts.taken)} taken along")
    if counts.left:
        text = f"{flight.path}: {_counted(counts.left)} left there, on frames without a place on this map"
        yield Notice(source="merge", level="warning", text=text)


def _counted(counts: Counter[str]) -> str:
    return ", ".join(f"{count} {kind}{'s' * (count > 1)}" for kind, count in counts.items())
