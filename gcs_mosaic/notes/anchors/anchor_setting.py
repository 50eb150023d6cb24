"""The setting `anchor: positions` of a flight, kept among its notes: there whoever shows or exports the flight finds it."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

from gcs_mosaic.errors import UsageError
from gcs_mosaic.messages import Notice
from gcs_mosaic.notes.anchors.pins import Pins
from gcs_mosaic.notes.storage.book import NotesBook
from gcs_mosaic.store.disk import CannotWrite

WHO = "--anchor positions"


def let_positions_lay(root: Path) -> Notice:
    """Let the positions of the triggers lay the map, unless somebody has decided before; returns what to say."""
    try:
        with closing(NotesBook(root)) as book:
            pins = Pins(book)
            if pins.asked_for_positions is None:
                pins.ask_for_positions(WHO, asked=True)
            elif not pins.asked_for_positions:
                text = "positions do not lay the map: somebody has switched that off on the page, where it can be switched on"
                return Notice(source="anchor", level="info", text=text)
    except (CannotWrite, OSError, UsageError, sqlite3.Error) as error:
        text = f"positions do not lay the map ({error}): ask for it on the page, or with `gcs-mosaic anchor DIR --positions`"
        return Notice(source="anchor", level="warning", text=text)
    text = "from the eighth position on the triggers' positions lay the map on earth, for showing only; pins go before them"
    return Notice(source="anchor", level="info", text=text)
