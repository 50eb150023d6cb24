"""Hints that somebody has dismissed, and that stay so."""

from __future__ import annotations

import re
import time

from gcs_mosaic.notes.book import NotesBook
from gcs_mosaic.notes.checked import Unfit

HINT = re.compile(r"[A-Za-z0-9._:-]{1,100}")  # key of a hint
MOST_DISMISSED = 50_000


class DismissedHints:
    """Raises what `NotesBook.change` and `rows` raise."""

    def __init__(self, book: NotesBook) -> None:
        self._book = book

    def all(self) -> list[dict[str, object]]:
        """Each with `hint`, `who` and `utc` (seconds since 1970), the first dismissed first."""
        return [dict(row) for row in self._book.rows("SELECT hint, who, utc FROM dismissed ORDER BY utc, hint")]

    def dismiss(self, hint: str, who: str) -> None:
        """Once more changes nothing. Raises Unfit."""
        if not HINT.fullmatch(hint):
            raise Unfit("hint is to be letters, digits and . _ : - (100 at most).")
        if self._book.rows("SELECT 1 FROM dismissed WHERE hint = ?", hint):
            return
        if self._book.rows("SELECT 1 WHERE (SELECT count(*) FROM dismissed) >= ?", MOST_DISMISSED):
            raise Unfit(f"{MOST_DISMISSED} hints were dismissed already.")
        with self._book.change() as file:
            file.write("INSERT INTO dismissed VALUES (?, ?, ?)", hint, who, time.time())

    def bring_back(self, hint: str) -> bool:
        """Undo; whether it had been dismissed."""
        if not self._book.rows("SELECT 1 FROM dismissed WHERE hint = ?", hint):
            return False
        with self._book.change() as file:
            file.write("DELETE FROM dismissed WHERE hint = ?", hint)
        return True
