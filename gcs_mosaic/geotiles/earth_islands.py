"""An island of the map with its anchor: what it covers on earth, and at which levels it is worth showing."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np

from gcs_mosaic.geo.anchor import Anchor, CanvasPlaces
from gcs_mosaic.geo.ellipsoid import Places
from gcs_mosaic.geo.mercator import HALF_WORLD_M, level_of, mercator, resolution_m
from gcs_mosaic.render.tile_grid import Box, pixel_size
from gcs_mosaic.store.told_islands import checked_islands

PER_SIDE = 32  # points of an outline: between them a side of 10 km bends by less than a centimetre

# West, south, east, north: degrees or metres of the map. East may lie beyond the 180th meridian.
Bounds: TypeAlias = tuple[float, float, float, float]


@dataclass(frozen=True)
class CanvasIsland:
    """An island as mosaic.json tells it. `box`: of its canvas; `coarsest`, `finest`: the canvas' levels with tiles."""

    id: int
    frames: int
    box: Box
    coarsest: int
    finest: int


@dataclass(frozen=True)
class EarthIsland(CanvasIsland):
    """An island where its anchor lays it."""

    anchor: Anchor

    @cached_property
    def outline(self) -> Places:
        """(n, 2) degrees, once round its box; longitudes go on beyond 180 degrees where it lies across."""
        places = going_on(self.anchor.places(outline_of(self.box)))
        places[:, 0] += 360.0 * (places[:, 0].min() < -180)
        return places

    @property
    def is_on_earth(self) -> bool:
        """Whether all of it lies near enough to what its anchor was made of to say where."""
        return bool(np.isfinite(self.outline).all())

    @cached_property
    def bounds(self) -> Bounds:
        """In degrees."""
        return bounds_of(self.outline)

    @cached_property
    def mercator_bounds(self) -> Bounds:
        """In metres of Web Mercator."""
        return bounds_of(mercator(self.outline))

    @property
    def latitude_deg(self) -> float:
        return (self.bounds[1] + self.bounds[3]) / 2

    @cached_property
    def levels(self) -> tuple[int, int]:
        """From where it is a pixel or so to where pixels are nearest those of its finest tiles."""
        west, south, east, north = self.mercator_bounds
        extent = max(east - west, north - south, resolution_m(30))
        coarsest = max(math.ceil(math.log2(2 * HALF_WORLD_M / 256 / extent)), 0)
        finest = level_of(self.anchor.metres_per_unit * pixel_size(self.finest), self.latitude_deg)
        return min(coarsest, finest), finest

    @cached_property
    def error_m(self) -> float:
        """How far off its worst corner may be (95 %)."""
        left, top, right, bottom = self.box
        corners = ((left, top), (right, top), (right, bottom), (left, bottom))
        return max(self.anchor.error(x, y).major_m for x, y in corners)


def canvas_islands(document: Mapping[str, Any]) -> tuple[CanvasIsland, ...]:
    """Those of mosaic.json that were not joined to another. Raises ValueError if it is none."""
    return tuple(_canvas_island(entry) for entry in checked_islands(document) if entry.get("merged_into") is None)


def earth_islands(islands: Iterable[CanvasIsland], anchors: Mapping[int, Anchor]) -> tuple[EarthIsland, ...]:
    """Those that have an anchor, the one with most frames last: it is shown on top."""
    found = [
        EarthIsland(one.id, one.frames, one.box, one.coarsest, one.finest, anchors[one.id])
        for one in islands
        if one.id in anchors
    ]
    return tuple(sorted((one for one in found if one.is_on_earth), key=lambda one: (one.frames, -one.id)))


def _canvas_island(entry: Mapping[str, Any]) -> CanvasIsland:
    left, top, right, bottom = map(float, entry["bounds"])
    frames, coarsest, finest = (int(entry[name]) for name in ("frames", "minzoom", "maxzoom"))
    return CanvasIsland(int(entry["id"]), frames, (left, top, right, bottom), coarsest, finest)


def outline_of(box: Box, per_side: int = PER_SIDE) -> CanvasPlaces:
    """(4 * per_side, 2) places once round a canvas box."""
    left, top, right, bottom = box
    along = np.arange(per_side) / per_side
    corners = np.array([[left, top], [right, top], [right, bottom], [left, bottom], [left, top]], np.float64)
    return np.concatenate([corners[at] + along[:, None] * (corners[at + 1] - corners[at]) for at in range(4)])


def going_on(places: Places) -> Places:
    """With longitudes that go on beyond 180 degrees, and do not begin anew in the west."""
    first = places[0, 0]
    return np.stack([first + (places[:, 0] - first + 180) % 360 - 180, places[:, 1]], axis=-1)


def bounds_of(points: Places) -> Bounds:
    (west, south), (east, north) = points.min(axis=0).tolist(), points.max(axis=0).tolist()
    return west, south, east, north
