"""What people have asked of hints: whether they are sought at all, and the colours that they have picked."""

from __future__ import annotations

import time
from dataclasses import dataclass

from gcs_mosaic.notes.storage.book import NoSuchNote, NotesBook
from gcs_mosaic.notes.storage.checked import Unfit

MOST_COLOURS = 12  # at a time: each costs a look at every frame
MOST_EVER = 10_000


@dataclass(frozen=True, slots=True, kw_only=True)
class PickedColour:
    """`bgr`: 8 bits each; `tolerance`: in CIE L*a*b* of 8 bits; `utc`: seconds since 1970."""

    id: int
    bgr: tuple[int, int, int]
    tolerance: float
    label: str
    who: str
    utc: float


class HintWishes:
    """Raises what `NotesBook.change` and `rows` raise."""

    def __init__(self, book: NotesBook) -> None:
        self._book = book

    @property
    def asked(self) -> bool | None:
        """Whether somebody has switched hints on or off; None: nobody has."""
        rows = self._book.rows("SELECT asked FROM hints_asked")
        return bool(rows[0]["asked"]) if rows else None

    def ask(self, who: str, *, asked: bool) -> None:
        """Switch hints on or off for everybody."""
        with self._book.change() as file:
            file.write("INSERT OR REPLACE INTO hints_asked VALUES (1, ?, ?, ?)", int(asked), who, time.time())

    def colours(self) -> list[PickedColour]:
        """Those that are sought, in the order in which they were picked."""
        rows = self._book.rows("SELECT * FROM picked_colours WHERE deleted = 0 ORDER BY id")
        return [
            PickedColour(
                id=row["id"],
                bgr=(row["blue"], row["green"], row["red"]),
                tolerance=row["tolerance"],
                label=row["label"],
                who=row["who"],
                utc=row["utc"],
            )
            for row in rows
        ]

    def pick(self, bgr: tuple[int, int, int], tolerance: float, label: str, who: str) -> PickedColour:
        """Seek a colour. Raises Unfit when there are too many."""
        if len(self.colours()) >= MOST_COLOURS:
            raise Unfit(f"{MOST_COLOURS} colours are sought already: take one away first.")
        if self._book.rows("SELECT 1 WHERE (SELECT count(*) FROM picked_colours) >= ?", MOST_EVER):
            raise Unfit(f"{MOST_EVER} colours were picked already.")
        columns = "blue, green, red, tolerance, label, who, utc"
        with self._book.change() as file:
            now = time.time()
            values = (*bgr, tolerance, label, who, now)
            made = file.write(f"INSERT INTO picked_colours ({columns}) VALUES (?, ?, ?, ?, ?, ?, ?)", *values)
        return PickedColour(id=made, bgr=bgr, tolerance=tolerance, label=label, who=who, utc=now)

    def take_away(self, number: int) -> None:
        """Seek it no more. Raises NoSuchNote."""
        with self._book.change() as file:
            if not file.changed("UPDATE picked_colours SET deleted = 1 WHERE id = ? AND deleted = 0", number):
                raise NoSuchNote
