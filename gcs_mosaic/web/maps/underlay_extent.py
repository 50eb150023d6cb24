"""Where a base map lies: its levels and its bounds, with bounded work whatever its file says and holds."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numpy as np

from gcs_mosaic.geo.ellipsoid import RADIUS_M
from gcs_mosaic.geo.mercator import MOST_LATITUDE_DEG, tile_corner

Span: TypeAlias = tuple[int, int]  # the first and the last
Bounds: TypeAlias = tuple[float, float, float, float]  # west, south, east, north, in degrees

COLUMNS = 64  # that are looked at, spread evenly
LONGEST_BOUNDS = 200  # characters


@dataclass(frozen=True, slots=True)
class UnderlayExtent:
    """`bounds`: of what there is at its finest level; `minzoom`, `maxzoom`: levels of which it has tiles."""

    bounds: Bounds
    minzoom: int
    maxzoom: int


class TileIndex(Protocol):
    """Which tiles there are, from any source. Each question is answered with bounded work."""

    def levels(self) -> list[int]:
        """Ascending."""

    def columns(self, level: int) -> Span | None:
        """None if there is none, or none that can be told; as with rows."""

    def rows(self, level: int, column: int) -> Span | None:
        """From the north."""

    def told_bounds(self) -> str | None:
        """What the source says of itself."""


def extent_of(index: TileIndex) -> UnderlayExtent | None:
    """Where the tiles lie, narrowed to what their source says of itself where that fits them; None if that cannot be told."""
    levels = index.levels()
    if not levels:
        return None
    bounds = narrowed(covered(index, levels[-1]), bounds_in(index.told_bounds()))
    return None if bounds is None else UnderlayExtent(bounds, levels[0], levels[-1])


def covered(index: TileIndex, level: int) -> Bounds | None:
    """The box of a level's tiles; its north and south by as many columns as can be looked at."""
    columns = index.columns(level)
    if columns is None:
        return None
    looked_at = sorted({round(at) for at in np.linspace(*columns, COLUMNS).tolist()})
    rows = [found for column in looked_at if (found := index.rows(level, column)) is not None]
    if not rows:
        return None
    west, north = place_of_corner(level, columns[0], min(first for first, _ in rows))
    east, south = place_of_corner(level, columns[1] + 1, max(last for _, last in rows) + 1)
    return west, south, east, north


def place_of_corner(level: int, x: int, y: int) -> tuple[float, float]:
    """Longitude and latitude in degrees of a tile's corner in the north-west; 180 at the world's edge in the east."""
    east, north = tile_corner(level, x, y)
    return math.degrees(east / RADIUS_M), math.degrees(math.atan(math.sinh(north / RADIUS_M)))


def bounds_in(told: str | None) -> Bounds | None:
    """Of a text "west,south,east,north" in degrees; None if it is no such text."""
    if told is None or len(told) > LONGEST_BOUNDS:
        return None
    try:
        west, south, east, north = map(float, told.split(","))
    except ValueError:
        return None
    bounds = max(west, -180.0), max(south, -MOST_LATITUDE_DEG), min(east, 180.0), min(north, MOST_LATITUDE_DEG)
    return bounds if is_box(bounds) else None


def narrowed(bounds: Bounds | None, told: Bounds | None) -> Bounds | None:
    """What both have in common; the first, if that is nothing."""
    if bounds is None or told is None:
        return bounds or told
    common = max(bounds[0], told[0]), max(bounds[1], told[1]), min(bounds[2], told[2]), min(bounds[3], told[3])
    return common if is_box(common) else bounds


def is_box(bounds: Bounds) -> bool:
    """False for what is empty, reversed or no number."""
    west, south, east, north = bounds
    return west < east and south < north and all(map(math.isfinite, bounds))
