"""How many metres a canvas unit is, from two points whose distance somebody knows."""

from __future__ import annotations

import math
import sqlite3
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

from gcs_mosaic.notes.ground.binding import Binding, GroundPlace
from gcs_mosaic.notes.ground.places import PLACE_COLUMNS, binding_of, place_row
from gcs_mosaic.notes.storage.book import NoSuchNote, NotesBook
from gcs_mosaic.notes.storage.checked import Unfit

MOST_SCALES = 1000
LEAST_UNITS = 1.0  # canvas units between the two points: nearer ones tell nothing


@dataclass(frozen=True, slots=True, kw_only=True)
class KnownDistance:
    """Two points and the metres between them; `utc`: seconds since 1970."""

    id: int
    deleted: bool
    ends: tuple[Binding, Binding]
    metres: float
    who: str
    utc: float


@dataclass(frozen=True, slots=True, kw_only=True)
class IslandScale:
    """Metres of a canvas unit of an island, and where that comes from."""

    island: int
    metres_per_unit: Annotated[float, "of the canvas"]
    source: Literal["distance", "anchor"]
    scale: Annotated[int | None, "id of the distance"]


def metres_per_unit(one: GroundPlace, other: GroundPlace, metres: float) -> float | None:
    """The length of a canvas unit by two points and their distance; None for points of two islands, or too near each other."""
    units = math.hypot(one.x - other.x, one.y - other.y)
    return metres / units if one.island == other.island and units >= LEAST_UNITS else None


def island_scales(
    known: Sequence[KnownDistance],
    place: Callable[[Binding], GroundPlace],
    anchored: Sequence[IslandScale] = (),
) -> dict[int, IslandScale]:
    """Each island's scale: by the newest distance that somebody has given, else by `anchored`, as an anchor tells it."""
    scales = {one.island: one for one in anchored}
    for one in known:
        first, second = map(place, one.ends)
        length = metres_per_unit(first, second, one.metres)
        if length is not None and not one.deleted:
            scales[first.island] = IslandScale(
                island=first.island, metres_per_unit=length, source="distance", scale=one.id
            )
    return scales


class Scales:
    """The known distances in a book of notes; raises what `NotesBook.change` and `rows` raise."""

    def __init__(self, book: NotesBook) -> None:
        self._book = book

    def all(self, *, deleted: bool = False) -> list[KnownDistance]:
        """In the order in which they were given."""
        rows = self._book.rows("SELECT * FROM scales WHERE deleted <= ? ORDER BY id", deleted)
        ends = self._book.rows("SELECT * FROM scale_ends ORDER BY scale, end")
        return [known_of(row, [end for end in ends if end["scale"] == row["id"]]) for row in rows]

    def create(self, ends: tuple[Binding, Binding], metres: float, who: str) -> KnownDistance:
        """Raises Unfit when there are too many."""
        if len(self._book.rows("SELECT 1 FROM scales")) >= MOST_SCALES:
            raise Unfit(f"{MOST_SCALES} distances were given already.")
        with self._book.change() as file:
            made = file.write("INSERT INTO scales (metres, who, utc) VALUES (?, ?, ?)", metres, who, time.time())
            for end, binding in enumerate(ends):
                values = (made, end, *place_row(binding))
                file.write(
                    f"INSERT INTO scale_ends (scale, end, {PLACE_COLUMNS}) VALUES (?, ?, ?, ?, ?, ?, ?, ?)", *values
                )
        return self.get(made)

    def get(self, number: int) -> KnownDistance:
        """Raises NoSuchNote."""
        found = [one for one in self.all(deleted=True) if one.id == number]
        if not found:
            raise NoSuchNote
        return found[0]

    def set_deleted(self, number: int, *, deleted: bool) -> KnownDistance:
        """Delete, or undo that. Raises NoSuchNote."""
        with self._book.change() as file:
            if not file.changed("UPDATE scales SET deleted = ? WHERE id = ?", int(deleted), number):
                raise NoSuchNote
        return self.get(number)


def known_of(row: sqlite3.Row, ends: Sequence[sqlite3.Row]) -> KnownDistance:
    first, second = map(binding_of, ends)
    return KnownDistance(
        id=row["id"],
        deleted=bool(row["deleted"]),
        ends=(first, second),
        metres=row["metres"],
        who=row["who"],
        utc=row["utc"],
    )
