"""`gcs-mosaic export --format debriefing`."""

from __future__ import annotations

import time
from pathlib import Path

from gcs_mosaic.export.whole_file import whole_file
from gcs_mosaic.handover.debriefing import as_debriefing
from gcs_mosaic.notes.anchors.anchoring import anchor_of
from gcs_mosaic.notes.anchors.stored_anchors import anchors_of
from gcs_mosaic.notes.finds.export_finds import finds_in
from gcs_mosaic.notes.finds.exports import in_number
from gcs_mosaic.notes.finds.finds import placed
from gcs_mosaic.notes.ground.binding import GroundFollower
from gcs_mosaic.store.folder import find_flight
from gcs_mosaic.views.coverage import IslandCoverage
from gcs_mosaic.views.flight_view import FlightView


def export_debriefing(flight: Path, target: Path) -> str:
    """Write it; returns a message. Raises UsageError."""
    view = FlightView(find_flight(flight))
    laid, finds = anchors_of(view), finds_in(flight)
    shown = placed(finds, GroundFollower(view), anchor_of(laid))
    with whole_file(target) as path:
        path.write_text(as_debriefing(view, shown, laid, IslandCoverage(view).of, time.time()), encoding="utf-8")
    return f"{in_number(finds)}, the map and what was not seen written to {target}: it opens without a network"
