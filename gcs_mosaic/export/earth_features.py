"""`gcs-mosaic export --format geojson`: outlines of the frames, the camera's path, gaps and finds, each with its error."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gcs_mosaic.detection.detection_areas import ADVICE, areas
from gcs_mosaic.detection.detections import Detections
from gcs_mosaic.detection.persons import Person
from gcs_mosaic.export.earth_map import EarthMap, left_out_words
from gcs_mosaic.export.whole_file import whole_file
from gcs_mosaic.geo.anchor import CanvasPlaces
from gcs_mosaic.geo.ellipsoid import Places
from gcs_mosaic.geotiles.earth_islands import Bounds, EarthIsland, going_on
from gcs_mosaic.notes.anchors.anchoring import anchor_of
from gcs_mosaic.notes.finds.export_finds import finds_in
from gcs_mosaic.notes.finds.exports import find_feature
from gcs_mosaic.notes.finds.finds import placed
from gcs_mosaic.notes.ground.binding import GroundFollower
from gcs_mosaic.notes.texts import shown
from gcs_mosaic.store.records import PositionRecord
from gcs_mosaic.views.coverage import IslandCoverage

DIGITS = 8  # of degrees: a millimetre
Feature = dict[str, Any]


def export_geojson(found: EarthMap, target: Path, person: Person | None = None) -> str:
    """Write a FeatureCollection (RFC 7946); returns a message. `person`: with where they would have been seen, and how probably.
    Raises UsageError."""
    features = [one for one in _features(found, person) if _is_within(one, found.box)]
    document = {"type": "FeatureCollection", "gcs_mosaic": found.about(), "features": features}
    with whole_file(target) as path:
        path.write_text(json.dumps(document, allow_nan=False), encoding="utf-8")
    kinds = [one["properties"]["is"] for one in features]
    told = ", ".join(f"{kinds.count(kind)} {kind}s" for kind in dict.fromkeys(kinds))
    return f"{told or 'nothing'}, {found.about()['error']}, written to {target}{left_out_words(found)}"


def _features(found: EarthMap, person: Person | None) -> Iterator[Feature]:
    for island in found.pyramid.islands:
        yield from _footprints(found, island)
        yield from _path(found, island)
        yield from _gaps(found, island)
        if person is not None:
            yield from _detection(found, island, person)
    yield from _finds(found)


def _footprints(found: EarthMap, island: EarthIsland) -> Iterator[Feature]:
    table = found.view.table()
    times = found.view.capture_times(table)
    for index, frame in enumerate(table.frames):
        outline = table.outlines[index]
        outline = outline[np.isfinite(outline).all(axis=1)]
        if frame.island == island.id and len(outline) >= 3:
            middle = outline.mean(axis=0)
            told = {
                "is": "footprint",
                "frame": shown(frame.name),
                "island": island.id,
                "error_m": _error(island, *middle),
            }
            told |= _whose(frame.vehicle)
            told |= (
                {"time": times[frame.number].iso(), "time_by": times[frame.number].by} if frame.number in times else {}
            )
            yield _feature("Polygon", [_ring(island, outline)], told)


def _path(found: EarthMap, island: EarthIsland) -> Iterator[Feature]:
    """The camera's own places over the ground, in the order in which the frames were taken; of several aircraft, each its own."""
    flown: dict[int | None, list[PositionRecord]] = {}
    for one in sorted(found.view.table().frames, key=lambda one: one.order):
        if one.island == island.id:
            flown.setdefault(one.vehicle, []).append(one)
    for vehicle, frames in flown.items():
        if len(frames) >= 2:
            canvas = np.array([[one.pose.x, one.pose.y] for one in frames])
            error_m = max(_error(island, *place) for place in canvas.tolist())
            told = {"is": "path", "island": island.id, "error_m": error_m, **_whose(vehicle)}
            told |= {"frames": [shown(one.name) for one in frames]}
            yield _feature("LineString", _degrees(island.anchor.places(canvas)), told)


def _whose(vehicle: int | None) -> dict[str, int]:
    """The aircraft, where each has a source of its own."""
    return {} if vehicle is None else {"vehicle": vehicle}


def _gaps(found: EarthMap, island: EarthIsland) -> Iterator[Feature]:
    gaps = IslandCoverage(found.view).of(island.id).gaps
    for gap in gaps:
        area = gap.area * island.anchor.metres_per_unit**2
        told = {"is": "gap", "island": island.id, "area_m2": round(area, 1), "error_m": _error(island, *gap.inside)}
        yield _feature("Polygon", [_ring(island, np.array(gap.outline))], told)


def _detection(found: EarthMap, island: EarthIsland, person: Person) -> Iterator[Feature]:
    side = person.side_m / island.anchor.metres_per_unit
    detections = Detections(found.view, IslandCoverage(found.view).of).whole(island.id, person, side)
    if detections is None or detections.is_grey:
        return
    for one in areas(detections):
        rings = [_ring(island, ring) for ring in one.rings]
        error = _error(island, *one.rings[0].mean(axis=0))
        told = {"is": "probability", "island": island.id, "posture": person.posture, "clothes": person.clothes}
        told |= {"from": one.least, "to": one.most, "mean": round(one.mean, 2), "error_m": error, "advice": ADVICE}
        told |= {"leaves_unknown": round(one.leaves_unknown, 2)}
        yield _feature("Polygon", [rings[0], *(ring[::-1] for ring in rings[1:])], told)


def _finds(found: EarthMap) -> Iterator[Feature]:
    follower = GroundFollower(found.view)
    for one in placed(finds_in(found.view.root), follower, anchor_of(found.laid)):
        if one.geo is not None and any(one.place.island == island.id for island in found.pyramid.islands):
            feature = find_feature(one)
            yield feature | {"properties": {"is": "find", **feature["properties"]}}


def _feature(kind: str, coordinates: Sequence[Any], told: dict[str, Any]) -> Feature:
    return {"type": "Feature", "geometry": {"type": kind, "coordinates": coordinates}, "properties": told}


def _ring(island: EarthIsland, outline: CanvasPlaces) -> list[list[float]]:
    """Closed, counterclockwise as RFC 7946 wants it: outlines on the canvas, whose y grows downwards, may go either way."""
    ring = _degrees(island.anchor.places(np.concatenate([outline, outline[:1]])))
    x, y = np.array(ring).T
    signed = float((x[:-1] * y[1:] - x[1:] * y[:-1]).sum())
    return ring if signed >= 0 else ring[::-1]


def _degrees(places: Places) -> list[list[float]]:
    """Across the 180th meridian longitudes go on: else a frame would reach once round the earth."""
    return [[round(value, DIGITS) for value in place] for place in going_on(places).tolist()]


def _error(island: EarthIsland, x: float, y: float) -> int:
    return math.ceil(island.anchor.error(float(x), float(y)).major_m)


def _is_within(feature: Feature, box: Bounds | None) -> bool:
    """Whether any corner lies in the box."""
    if box is None:
        return True
    corners = feature["geometry"]["coordinates"]
    outer = corners[0] if feature["geometry"]["type"] == "Polygon" else corners
    points = np.array(outer, np.float64).reshape(-1, 2)
    return bool(((points >= box[:2]) & (points <= box[2:])).all(axis=1).any())
