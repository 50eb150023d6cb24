"""Finds: markers that people have set, with who, when and a note."""

from __future__ import annotations

import sqlite3
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from gcs_mosaic.notes.ground.binding import Binding, GroundFollower, GroundPlace
from gcs_mosaic.notes.ground.places import PLACE_COLUMNS, GeoPlace, binding_of, place_row
from gcs_mosaic.notes.storage.book import NoSuchNote, NotesBook
from gcs_mosaic.notes.storage.checked import Unfit

MOST_FINDS = 5000
MOST_DELETED = 1000  # kept for an undo, the newest
TEXTS = ("kind", "label", "note")

# Longitude and latitude in degrees and their error in metres, of a canvas place; None where the map has no anchor.
Anchor = Callable[[GroundPlace], GeoPlace | None]


class Outdated(Exception):  # noqa: N818 - names a state, not an error
    """Somebody else has changed it since; `newest` is what it has become."""

    def __init__(self, newest: Find) -> None:
        super().__init__(newest.id)
        self.newest = newest


@dataclass(frozen=True, slots=True, kw_only=True)
class Find:
    """A marker. Times are seconds since 1970 by the server's clock; `revision` grows with each change of it."""

    id: int
    revision: int
    deleted: bool
    kind: str
    label: str
    note: str
    who: str
    created_utc: float
    changed_by: str
    changed_utc: float
    in_original: bool  # set in a frame's original, not on the map
    binding: Binding


@dataclass(frozen=True, slots=True, kw_only=True)
class NewFind:
    """What a find is made of. `key` is given by who makes it: sent again, it makes no second one."""

    kind: str
    label: str
    note: str
    who: str
    in_original: bool
    binding: Binding
    key: str | None = None


@dataclass(frozen=True, slots=True)
class PlacedFind:
    """A find, and where it lies now; `geo` as soon as the map has an anchor."""

    find: Find
    place: GroundPlace
    geo: GeoPlace | None


class Finds:
    """The finds in a book of notes; raises what `NotesBook.change` and `rows` raise."""

    def __init__(self, book: NotesBook) -> None:
        self._book = book

    def all(self, *, deleted: bool = False) -> list[Find]:
        """In the order in which they were made; `deleted`: those that were deleted too."""
        return [find_of(row) for row in self._book.rows("SELECT * FROM finds WHERE deleted <= ? ORDER BY id", deleted)]

    def get(self, number: int) -> Find:
        """Deleted or not. Raises NoSuchNote."""
        rows = self._book.rows("SELECT * FROM finds WHERE id = ?", number)
        if not rows:
            raise NoSuchNote
        return find_of(rows[0])

    def create(self, new: NewFind) -> Find:
        """Raises Unfit when there are too many."""
        known = self._book.rows("SELECT * FROM finds WHERE key = ?", new.key) if new.key else []
        if known:
            return find_of(known[0])
        if self._book.rows("SELECT 1 WHERE (SELECT count(*) FROM finds WHERE deleted = 0) >= ?", MOST_FINDS):
            raise Unfit(f"There are {MOST_FINDS} finds already: delete some.")
        now, place = time.time(), place_row(new.binding)
        values = (new.key, 1, new.kind, new.label, new.note, new.who, now, new.who, now, new.in_original, *place)
        columns = "key, revision, kind, label, note, who, created_utc, changed_by, changed_utc, in_original"
        with self._book.change() as file:
            made = file.write(
                f"INSERT INTO finds ({columns}, {PLACE_COLUMNS}) VALUES ({', '.join('?' * len(values))})", *values
            )
        return self.get(made)

    def edit(self, number: int, revision: int, who: str, changes: dict[str, Any], binding: Binding | None) -> Find:
        """Change some of `TEXTS`, and its place. Raises NoSuchNote, and Outdated if it is not at that revision any more."""
        values: dict[str, Any] = {name: changes[name] for name in TEXTS if name in changes}
        if binding is not None:
            names = PLACE_COLUMNS.split(", ")
            values |= dict(zip(names, place_row(binding), strict=True)) | {"in_original": changes["in_original"]}
        return self._set(number, revision, who, values)

    def delete(self, number: int, revision: int, who: str) -> Find:
        """It is kept for an undo (`restore`). Raises as `edit`."""
        found = self._set(number, revision, who, {"deleted": 1})
        newest = "SELECT id FROM finds WHERE deleted ORDER BY changed_utc DESC, id DESC LIMIT ?"
        if len(self._book.rows("SELECT 1 FROM finds WHERE deleted LIMIT ?", MOST_DELETED + 1)) > MOST_DELETED:
            with self._book.change() as file:
                file.changed(f"DELETE FROM finds WHERE deleted AND id NOT IN ({newest})", MOST_DELETED)
        return found

    def restore(self, number: int, revision: int, who: str) -> Find:
        """Undo a deletion. Raises as `edit`."""
        return self._set(number, revision, who, {"deleted": 0})

    def _set(self, number: int, revision: int, who: str, values: dict[str, Any]) -> Find:
        values = values | {"changed_by": who, "changed_utc": time.time()}
        columns = ", ".join(f"{name} = ?" for name in values)
        with self._book.change() as file:
            rows = file.rows("SELECT * FROM finds WHERE id = ?", number)
            if not rows:
                raise NoSuchNote
            if rows[0]["revision"] != revision:
                raise Outdated(find_of(rows[0]))
            file.update(f"UPDATE finds SET revision = revision + 1, {columns} WHERE id = ?", *values.values(), number)
        return self.get(number)


def find_of(row: sqlite3.Row) -> Find:
    return Find(
        **{name: row[name] for name in ("id", "revision", *TEXTS, "who", "created_utc", "changed_by", "changed_utc")},
        deleted=bool(row["deleted"]),
        in_original=bool(row["in_original"]),
        binding=binding_of(row),
    )


def placed(finds: Sequence[Find], follower: GroundFollower, anchor: Anchor | None = None) -> list[PlacedFind]:
    """Each find where it lies now."""
    found = [(find, follower.place(find.binding)) for find in finds]
    return [PlacedFind(find, place, anchor(place) if anchor else None) for find, place in found]
