"""Pins that people have set, and whether the positions of the triggers may lay the map where there are none."""

from __future__ import annotations

import sqlite3
import time
from dataclasses import dataclass

from gcs_mosaic.notes.ground.binding import Binding
from gcs_mosaic.notes.ground.places import PLACE_COLUMNS, binding_of, place_row
from gcs_mosaic.notes.storage.book import NoSuchNote, NotesBook
from gcs_mosaic.notes.storage.checked import Unfit

MOST_PINS = 1000
MOST_DELETED = 1000  # kept for an undo, the newest


@dataclass(frozen=True, slots=True, kw_only=True)
class NewPin:
    """A place of the map and its coordinate: `written` as it was given, degrees, one standard deviation in metres."""

    label: str
    written: str
    longitude_deg: float
    latitude_deg: float
    sigma_m: float
    who: str
    binding: Binding


@dataclass(frozen=True, slots=True, kw_only=True)
class SetPin:
    """A pin that was set; `utc`: seconds since 1970."""

    id: int
    deleted: bool
    utc: float
    pin: NewPin

    @property
    def name(self) -> str:
        """What people call it."""
        return self.pin.label or f"pin {self.id}"


class Pins:
    """The pins in a book of notes; raises what `NotesBook.change` and `rows` raise."""

    def __init__(self, book: NotesBook) -> None:
        self._book = book

    @property
    def by_positions(self) -> bool:
        """Whether somebody has asked that positions lay the map."""
        return bool(self.asked_for_positions)

    @property
    def asked_for_positions(self) -> bool | None:
        """Whether somebody wants it or does not; None: nobody has said."""
        rows = self._book.rows("SELECT by_positions FROM anchoring")
        return bool(rows[0]["by_positions"]) if rows else None

    def ask_for_positions(self, who: str, *, asked: bool) -> None:
        """Let the positions of the triggers lay the map where there are no pins, or not."""
        with self._book.change() as file:
            file.write("INSERT OR REPLACE INTO anchoring VALUES (1, ?, ?, ?)", int(asked), who, time.time())

    def all(self, *, deleted: bool = False) -> list[SetPin]:
        """In the order in which they were set; `deleted`: those that were deleted too."""
        return [pin_of(row) for row in self._book.rows("SELECT * FROM pins WHERE deleted <= ? ORDER BY id", deleted)]

    def get(self, number: int) -> SetPin:
        """Deleted or not. Raises NoSuchNote."""
        rows = self._book.rows("SELECT * FROM pins WHERE id = ?", number)
        if not rows:
            raise NoSuchNote
        return pin_of(rows[0])

    def create(self, new: NewPin) -> SetPin:
        """Raises Unfit when there are too many."""
        if len(self._book.rows("SELECT 1 FROM pins WHERE deleted = 0")) >= MOST_PINS:
            raise Unfit(f"{MOST_PINS} pins were set already.")
        head = (new.label, new.written, new.longitude_deg, new.latitude_deg, new.sigma_m, new.who, time.time())
        values = (*head, *place_row(new.binding))
        columns = f"label, written, longitude_deg, latitude_deg, sigma_m, who, utc, {PLACE_COLUMNS}"
        with self._book.change() as file:
            made = file.write(f"INSERT INTO pins ({columns}) VALUES ({', '.join('?' * len(values))})", *values)
        return self.get(made)

    def set_deleted(self, number: int, *, deleted: bool) -> SetPin:
        """Delete, or undo that. Raises NoSuchNote."""
        with self._book.change() as file:
            if not file.changed("UPDATE pins SET deleted = ? WHERE id = ?", int(deleted), number):
                raise NoSuchNote
            newest = "SELECT id FROM pins WHERE deleted ORDER BY id DESC LIMIT ?"
            file.changed(f"DELETE FROM pins WHERE deleted AND id != ? AND id NOT IN ({newest})", number, MOST_DELETED)
        return self.get(number)


def pin_of(row: sqlite3.Row) -> SetPin:
    new = NewPin(
        label=row["label"],
        written=row["written"],
        longitude_deg=row["longitude_deg"],
        latitude_deg=row["latitude_deg"],
        sigma_m=row["sigma_m"],
        who=row["who"],
        binding=binding_of(row),
    )
    return SetPin(id=row["id"], deleted=bool(row["deleted"]), utc=row["utc"], pin=new)
