"""What lays a flight's map on earth, read for a program that changes nothing."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from gcs_mosaic.notes.anchors.anchoring import Anchoring, IslandAnchor
from gcs_mosaic.notes.anchors.pins import SetPin, pin_of
from gcs_mosaic.notes.ground.binding import GroundFollower
from gcs_mosaic.notes.storage.book import NotesFile
from gcs_mosaic.store import inside
from gcs_mosaic.store.folder import NOTES_NAME
from gcs_mosaic.views.flight_view import FlightView


def anchors_of(view: FlightView) -> Mapping[int, IslandAnchor]:
    """How each island lies, or why it is not laid; those without pins or positions that were asked for are absent. Raises
    UsageError."""
    pins, by_positions = _pinned(view.root / NOTES_NAME)
    return Anchoring(view, GroundFollower(view)).islands(pins, by_positions=by_positions)


def _pinned(path: Path) -> tuple[list[SetPin], bool]:
    """The pins that were not deleted, and whether positions may lay the map."""
    if not inside.exists(path, path.parent):
        return [], False
    with NotesFile(path, read_only=True) as file:
        if not file.rows("SELECT 1 FROM sqlite_schema WHERE name = 'pins'"):  # written before there were any
            return [], False
        pins = [pin_of(row) for row in file.rows("SELECT * FROM pins WHERE deleted = 0 ORDER BY id")]
        return pins, any(row["by_positions"] for row in file.rows("SELECT by_positions FROM anchoring"))
