"""Hints that somebody has dismissed, and that stay so."""

from __future__ import annotations

import re
import time
from dataclasses import dataclass
from typing import Annotated

from gcs_mosaic.notes.storage.book import NotesBook
from gcs_mosaic.notes.storage.checked import Unfit, Utc, Who
from gcs_mosaic.store.documents import Limits

HINT = re.compile(r"[A-Za-z0-9._:-]{1,100}")  # key of a hint
HintKey = Annotated[str, Limits(shortest=1, longest=100, pattern=f"^{HINT.pattern}$"), "key of a hint"]
MOST_DISMISSED = 50_000


@dataclass(frozen=True, slots=True, kw_only=True)
class DismissedHint:
    """Who has dismissed a hint, and when."""

    hint: HintKey
    who: Who
    utc: Utc


class DismissedHints:
    """Raises what `NotesBook.change` and `rows` raise."""

    def __init__(self, book: NotesBook) -> None:
        self._book = book

    def all(self) -> list[DismissedHint]:
        """The first dismissed first."""
        rows = self._book.rows("SELECT hint, who, utc FROM dismissed ORDER BY utc, hint")
        return [DismissedHint(hint=row["hint"], who=row["who"], utc=row["utc"]) for row in rows]

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
