"""Whether what people have added to a flight can be read. Nothing can make it anew, so no repair touches it."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

from gcs_mosaic.check.findings import CheckedPart
from gcs_mosaic.errors import UsageError
from gcs_mosaic.notes.storage.schema import NOTES
from gcs_mosaic.store import inside
from gcs_mosaic.store.folder import NOTES_NAME
from gcs_mosaic.store.schema import connect_for_reading

COUNTED = ("finds", "scales", "reviewed", "dismissed")


def check_notes(flight: Path, part: CheckedPart) -> None:
    """Add to `part` what is wrong with a flight's notes, if there are any."""
    path = flight / NOTES_NAME
    if not inside.exists(path, flight):
        part.notes.append("there are none")
        return
    try:
        with closing(connect_for_reading(path, NOTES)) as found:
            problems = [str(row[0]) for row in found.execute("PRAGMA integrity_check(3)")]
            part.checked = sum(found.execute(f"SELECT count(*) FROM {table}").fetchone()[0] for table in COUNTED)
            orphans = found.execute("PRAGMA foreign_key_check").fetchall()
    except (UsageError, sqlite3.DatabaseError) as error:
        part.fault(NOTES_NAME, f"cannot be read, and is left as it is: {error}")
        return
    if problems != ["ok"]:
        part.fault(NOTES_NAME, f"is damaged, and left as it is: {' '.join(problems)}")
    if orphans:
        part.fault(NOTES_NAME, "its tables contradict each other")
