"""`gcs-mosaic export --format finds-...`: the finds of a flight as one file."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

from gcs_mosaic.errors import UsageError
from gcs_mosaic.notes.anchors.anchoring import anchor_of
from gcs_mosaic.notes.anchors.stored_anchors import anchors_of
from gcs_mosaic.notes.finds.exports import CSV_ENCODING, anchor_words, as_csv, as_geojson, as_kml, in_number
from gcs_mosaic.notes.finds.finds import Find, find_of, placed
from gcs_mosaic.notes.finds.report import BeneathOf, as_report
from gcs_mosaic.notes.ground.binding import GroundFollower
from gcs_mosaic.notes.storage.book import NotesFile
from gcs_mosaic.store import inside
from gcs_mosaic.store.disk import DiskFull, write_beside
from gcs_mosaic.store.folder import NOTES_NAME, find_flight
from gcs_mosaic.views.flight_view import FlightView

HOW = (
    "Two pins on the page, or `gcs-mosaic anchor DIR --points FILE`, lay it on earth (`gcs-mosaic anchor DIR` says why those "
    "that are set do not); then export again."
)


def export_finds(
    flight: Path, kind: str, target: Path, beneath: Callable[[FlightView], BeneathOf] | None = None
) -> str:
    """Write all finds as geojson, csv, kml or a report, with coordinates where the map has an anchor; returns a message.
    `beneath`: of a flight, for a report, see `report.cards`. Raises UsageError."""
    view = FlightView(find_flight(flight))
    found = finds_in(flight)
    shown, name = placed(found, GroundFollower(view), anchor_of(anchors_of(view))), flight.resolve().name
    match kind:
        case "csv":
            text = as_csv(shown)
        case "report":
            text = as_report(shown, name, view, time.time(), None if beneath is None else beneath(view))
        case _:
            text = (as_geojson if kind == "geojson" else as_kml)(shown, name)
    try:
        write_beside(target, text.encode(CSV_ENCODING if kind == "csv" else "utf-8"))
    except (OSError, DiskFull) as error:
        raise UsageError(f"{target} cannot be written ({error}); give another file.") from error
    said = "".join(f"\nwarning: {text} {HOW}" for text in anchor_words(shown))
    return f"{in_number(found)} written to {target}{said}"


def finds_in(flight: Path) -> list[Find]:
    """Those of a flight that were not deleted; nothing is written for it. Raises UsageError."""
    if not inside.exists(flight / NOTES_NAME, flight):
        return []
    with NotesFile(flight / NOTES_NAME, read_only=True) as file:
        return [find_of(row) for row in file.rows("SELECT * FROM finds WHERE deleted = 0 ORDER BY id")]
