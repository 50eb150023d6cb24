"""A bound place as it is answered, as it lies on earth, and as it is stored."""

from __future__ import annotations

import sqlite3
from dataclasses import dataclass
from typing import Annotated

from gcs_mosaic.notes.ground.binding import Binding, GroundPlace
from gcs_mosaic.notes.texts import shown
from gcs_mosaic.store.stored_text import restored, stored

PLACE_COLUMNS = "island, x, y, frame, pixel_x, pixel_y"


@dataclass(frozen=True, slots=True)
class GeoPlace:
    """A place on earth (WGS 84), and how far off it may be."""

    longitude_deg: float
    latitude_deg: float
    error_m: float


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


def place_row(binding: Binding) -> tuple[object, ...]:
    """Values of PLACE_COLUMNS."""
    pixel = binding.pixel or (None, None)
    return (binding.island, binding.x, binding.y, stored(binding.frame), *pixel)


def binding_of(row: sqlite3.Row) -> Binding:
    """Inverse of `place_row`."""
    pixel = None if row["pixel_x"] is None else (row["pixel_x"], row["pixel_y"])
    return Binding(island=row["island"], x=row["x"], y=row["y"], frame=restored(row["frame"]), pixel=pixel)
