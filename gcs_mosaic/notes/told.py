"""Finds as they are told: where they lie now, and what may be shown of names."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Annotated

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


@dataclass(frozen=True, slots=True, kw_only=True)
class FollowedPixel:
    """The pixel of a frame's original that a place follows."""

    number: Annotated[int | None, "of the frame; null while it is not painted"]
    name: str
    pixel: tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class PlaceAnswer:
    """A place on an island's canvas."""

    island: int
    x: float
    y: float
    frame: FollowedPixel | None
    follows: Annotated[bool, "whether the place follows its frame as the map moves"]


def place_answer(binding: Binding, place: GroundPlace) -> PlaceAnswer:
    """A place where it lies now, and the pixel that it follows."""
    frame = None
    if binding.frame is not None and binding.pixel is not None:
        frame = FollowedPixel(number=place.number, name=shown(binding.frame), pixel=binding.pixel)
    return PlaceAnswer(island=place.island, x=place.x, y=place.y, frame=frame, follows=place.number is not None)


def shown(text: str) -> str:
    """A name that may hold undecodable bytes or control characters, for showing."""
    told = text.encode("utf-8", "replace").decode("utf-8")
    return "".join(letter if letter.isprintable() else "\ufffd" for letter in told)


def iso(utc: float) -> str:
    """Seconds since 1970 as ISO 8601, in UTC."""
    return datetime.fromtimestamp(utc, UTC).isoformat(timespec="seconds").replace("+00:00", "Z")
