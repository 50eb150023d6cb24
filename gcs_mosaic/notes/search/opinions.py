"""What others say of a find: yes, no or unsure, each person once, by name; the last word counts."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Literal

from gcs_mosaic.notes.storage.book import NoSuchNote, NotesBook
from gcs_mosaic.notes.storage.checked import Unfit, Utc, Who

MOST_OPINIONS = 10_000
Opinion = Literal["yes", "no", "unsure"]


@dataclass(frozen=True, slots=True, kw_only=True)
class FindOpinion:
    """What somebody says of a find."""

    find: int
    who: Who
    opinion: Opinion
    utc: Utc


class Opinions:
    """Raises what `NotesBook.change` and `rows` raise."""

    def __init__(self, book: NotesBook) -> None:
        self._book = book

    def all(self) -> list[FindOpinion]:
        """By finds, the first first."""
        rows = self._book.rows("SELECT find, who, opinion, utc FROM opinions ORDER BY find, utc, who")
        return [FindOpinion(find=row["find"], who=row["who"], opinion=row["opinion"], utc=row["utc"]) for row in rows]

    def say(self, find: int, who: str, opinion: Opinion) -> None:
        """Raises NoSuchNote; Unfit for whoever has set the find themselves, and when there are too many."""
        found = self._book.rows("SELECT who FROM finds WHERE id = ? AND deleted = 0", find)
        if not found:
            raise NoSuchNote
        if found[0]["who"] == who:
            raise Unfit("A second opinion is to come from somebody else than who has set the find: give another name.")
        if len(self._book.rows("SELECT 1 FROM opinions")) >= MOST_OPINIONS:
            raise Unfit(f"{MOST_OPINIONS} opinions were given already.")
        with self._book.change() as file:
            file.write("INSERT OR REPLACE INTO opinions VALUES (?, ?, ?, ?)", find, who, opinion, time.time())
