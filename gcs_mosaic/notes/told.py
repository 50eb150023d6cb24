"""Finds as they are told: where they lie now, and what may be shown of names."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

from gcs_mosaic.notes.binding import Binding, GroundFollower, GroundPlace
from gcs_mosaic.notes.finds import Find

# Longitude and latitude in degrees and their error in metres, of a canvas place; None where the map has no anchor.
Anchor = Callable[[GroundPlace], "GeoPlace | None"]


@dataclass(frozen=True, slots=True)
class GeoPlace:
    """A place on earth (WGS 84), and how far off it may be."""

    longitude_deg: float
    latitude_deg: float
    error_m: float


@dataclass(frozen=True, slots=True)
class PlacedFind:
    """A find, and where it lies now; `geo` as soon as the map has an anchor."""

    find: Find
    place: GroundPlace
    geo: GeoPlace | None


def placed(finds: Sequence[Find], follower: GroundFollower, anchor: Anchor | None = None) -> list[PlacedFind]:
    """Each find where it lies now."""
    found = [(find, follower.place(find.binding)) for find in finds]
    return [PlacedFind(find, place, anchor(place) if anchor else None) for find, place in found]


def find_document(one: PlacedFind) -> dict[str, Any]:
    """As in the API's answers."""
    find, place = one.find, one.place
    return {
        **{name: getattr(find, name) for name in ("id", "revision", "deleted", "kind", "label", "note", "who")},
        **{name: getattr(find, name) for name in ("created_utc", "changed_by", "changed_utc", "in_original")},
        **place_document(find.binding, place),
        "geo": one.geo
        and {"longitude": one.geo.longitude_deg, "latitude": one.geo.latitude_deg, "error_m": one.geo.error_m},
    }


def place_document(binding: Binding, place: GroundPlace) -> dict[str, Any]:
    """Island and canvas place, the frame that it follows (`number` is null while that is not painted) and the pixel there."""
    frame = None
    if binding.frame is not None and binding.pixel is not None:
        frame = {"number": place.number, "name": shown(binding.frame), "pixel": list(binding.pixel)}
    return {"island": place.island, "x": place.x, "y": place.y, "frame": frame, "follows": place.number is not None}


def shown(text: str) -> str:
    """A name that may hold undecodable bytes or control characters, for showing."""
    told = text.encode("utf-8", "replace").decode("utf-8")
    return "".join(letter if letter.isprintable() else "\ufffd" for letter in told)


def iso(utc: float) -> str:
    """Seconds since 1970 as ISO 8601, in UTC."""
    return datetime.fromtimestamp(utc, UTC).isoformat(timespec="seconds").replace("+00:00", "Z")
