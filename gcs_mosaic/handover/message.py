"""A find in a message: what, where and how exactly, when; and the picture of it."""

from __future__ import annotations

import math
from collections.abc import Iterator

from gcs_mosaic.notes.finds.exports import NO_ANCHOR
from gcs_mosaic.notes.finds.finds import PlacedFind
from gcs_mosaic.notes.finds.report import coordinate, crop_of, original
from gcs_mosaic.notes.texts import iso, shown
from gcs_mosaic.views.flight_view import FlightView


def as_message(one: PlacedFind, flight: str, view: FlightView) -> str:
    """Lines of text; `geo:` is an address (RFC 5870) that telephones open in their map."""
    return "\n".join(_lines(one, flight, view)) + "\n"


def crop_of_find(one: PlacedFind, view: FlightView) -> bytes | None:
    """JPEG of what the find shows; None if it follows no original that can be read."""
    image = None if one.place.number is None else original(view, one.place.number)
    return None if image is None else crop_of(image, one.find.binding.pixel or (0.0, 0.0))


def _lines(one: PlacedFind, flight: str, view: FlightView) -> Iterator[str]:
    find, geo = one.find, one.geo
    yield " - ".join(text for text in (f"Find {find.id} of {shown(flight)}", find.kind, find.label) if text)
    if geo is None:
        yield f"island {one.place.island}, canvas {one.place.x:.0f}, {one.place.y:.0f}. {NO_ANCHOR}"
    else:
        yield coordinate(geo)
        yield f"geo:{geo.latitude_deg:.6f},{geo.longitude_deg:.6f};u={math.ceil(geo.error_m)}"
    if find.note:
        yield find.note
    frame = None if one.place.number is None else view.frame(one.place.number)
    if frame is not None:
        taken = None if one.place.number is None else view.capture_time(one.place.number)
        yield f"in {shown(frame.name)}{'' if taken is None else f', {taken.words()}'}"
    yield f"marked by {find.who}, {iso(find.created_utc)}"
