"""`gcs-mosaic export --format debriefing`."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from contextlib import closing
from functools import partial
from pathlib import Path

from gcs_mosaic.detection.detections import Detections
from gcs_mosaic.detection.persons import Person
from gcs_mosaic.export.whole_file import whole_file
from gcs_mosaic.handover.debriefing import Searched, as_debriefing
from gcs_mosaic.handover.search_course import Looked, SoughtPerson, looked_at
from gcs_mosaic.notes.anchors.anchoring import IslandAnchor, anchor_of, anchored
from gcs_mosaic.notes.anchors.scales import Scales, island_scales
from gcs_mosaic.notes.anchors.stored_anchors import anchors_of
from gcs_mosaic.notes.finds.export_finds import finds_in
from gcs_mosaic.notes.finds.exports import in_number
from gcs_mosaic.notes.finds.finds import placed
from gcs_mosaic.notes.ground.binding import GroundFollower
from gcs_mosaic.notes.search.reviews import Reviews
from gcs_mosaic.notes.search.seen_ground import IslandGround
from gcs_mosaic.notes.storage.book import NotesBook
from gcs_mosaic.store import inside
from gcs_mosaic.store.folder import NOTES_NAME, find_flight
from gcs_mosaic.store.told_islands import told_islands
from gcs_mosaic.views.coverage import IslandCoverage
from gcs_mosaic.views.flight_view import FlightView


def export_debriefing(
    flight: Path, target: Path, person: Person | None = None, told: Callable[[int, int], None] | None = None
) -> str:
    """Write it; returns a message. `person`: whom the probability is of; `told`: of how many pictures that are measured for it.
    Raises UsageError."""
    view = FlightView(find_flight(flight))
    coverage = IslandCoverage(view)
    laid, finds = anchors_of(view), finds_in(flight)
    looked, metres = _noted(view, laid)
    detections = Detections(view, coverage.of)
    searched = Searched(
        finds=placed(finds, GroundFollower(view), anchor_of(laid)),
        laid=laid,
        looked=looked,
        sought=SoughtPerson(person or Person(), detections, partial(detections.whole, told=told), metres),
    )
    with whole_file(target) as path:
        path.write_text(as_debriefing(view, searched, coverage.of, time.time()), encoding="utf-8")
    return f"{in_number(finds)}, the map and what was not seen written to {target}: it opens without a network"


def _noted(view: FlightView, laid: Mapping[int, IslandAnchor]) -> tuple[dict[int, Looked], dict[int, float]]:
    """What was looked at of each island, and how many metres a canvas unit of it has."""
    scales = anchored(laid)
    if not inside.exists(view.root / NOTES_NAME, view.root):
        return {}, {one.island: one.metres_per_unit for one in scales}
    table, grounds, looked = view.table(), IslandGround(), {}
    with closing(NotesBook(view.root)) as book:
        reviews = Reviews(book)
        for one in told_islands(view.root):
            if one.get("merged_into") is None:
                ground = grounds.of(table, one["id"], float("inf"))
                looked[one["id"]] = looked_at(reviews, ground, one["id"], one["maxzoom"])
        known = island_scales(Scales(book).all(), GroundFollower(view).place, scales)
    return looked, {island: one.metres_per_unit for island, one in known.items()}
