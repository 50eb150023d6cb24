"""`gcs-mosaic export --format mission-...`: what is to be flown again, as a file of a ground station."""

from __future__ import annotations

from pathlib import Path

from gcs_mosaic.errors import UsageError
from gcs_mosaic.export.whole_file import whole_file
from gcs_mosaic.handover.mission import MissionWish, planned
from gcs_mosaic.handover.mission_files import MISSION_FILES
from gcs_mosaic.notes.anchors.stored_anchors import anchors_of
from gcs_mosaic.store.folder import find_flight
from gcs_mosaic.store.told_islands import told_islands
from gcs_mosaic.views.coverage import IslandCoverage
from gcs_mosaic.views.flight_view import FlightView


def export_mission(flight: Path, target: Path, kind: str, wish: MissionWish) -> str:
    """Write it; returns a message. Raises UsageError."""
    folder = find_flight(flight)
    islands = [one["id"] for one in told_islands(folder) if one.get("merged_into") is None]
    if wish.island not in (None, *islands):
        raise UsageError(f"There is no island {wish.island} in {flight}; there are: {', '.join(map(str, islands))}.")
    view = FlightView(folder)
    anchors = {number: one.anchor for number, one in anchors_of(view).items() if one.anchor is not None}
    mission = planned(view, anchors, islands, IslandCoverage(view).of, wish)
    with whole_file(target) as path:
        path.write_text(MISSION_FILES[kind](mission), encoding="utf-8")
    return "\n".join([f"a mission written to {target}", *mission.sentences()])
