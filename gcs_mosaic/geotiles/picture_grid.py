"""Where the pixels of a picture of the earth lie: on Web Mercator (EPSG:3857), on longitude and latitude (EPSG:4326), or in a
zone of UTM (EPSG:326.. and 327..)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from gcs_mosaic.geo.ellipsoid import Floats, Places, metres_per_degree
from gcs_mosaic.geo.mercator import (
    HALF_WORLD_M,
    TILE_SIZE,
    ground_scale,
    places_of_mercator,
    resolution_m,
    tile_corner,
)
from gcs_mosaic.geo.transverse_mercator import FALSE_NORTHING_M, UtmPlace, place_of_utm, projected
from gcs_mosaic.geotiles.earth_islands import Bounds, EarthIsland, bounds_of


@dataclass(frozen=True, slots=True)
class UtmZone:
    """A zone of UTM (1 to 60), north or south of the equator."""

    number: int
    is_north: bool

    @property
    def epsg(self) -> int:
        return (32600 if self.is_north else 32700) + self.number

    def points(self, places: Places) -> Floats:
        """(n, 2) eastings and northings of places in degrees."""
        north = 0.0 if self.is_north else FALSE_NORTHING_M
        found = [projected(longitude, latitude, self.number) for longitude, latitude in places.tolist()]
        return np.asarray(np.array(found, np.float64) + np.array([0.0, north]))

    def places(self, points: Floats) -> Places:
        """(..., 2) degrees of eastings and northings."""
        found = [place_of_utm(UtmPlace(self.number, self.is_north, *point)) for point in points.reshape(-1, 2).tolist()]
        return np.array(found, np.float64).reshape(points.shape)


@dataclass(frozen=True, slots=True)
class PictureGrid:
    """A picture, north up: its bounds in metres of Mercator or of a zone of UTM, or in degrees, and its size in pixels."""

    plane: Literal["mercator", "degrees", "utm"]
    bounds: Bounds
    width: int
    height: int
    zone: UtmZone | None = None  # of the plane "utm"

    def places(self, columns: Floats, rows: Floats) -> Places:
        """(rows, columns, 2) degrees at edges of pixels, counted from the left and from the top."""
        west, _, _, north = self.bounds
        across, down = self.steps
        x, y = np.meshgrid(west + columns * across, north - rows * down)
        points = np.stack([x, y], axis=-1)
        if self.zone is not None:
            return self.zone.places(points)
        return places_of_mercator(points) if self.plane == "mercator" else points

    @property
    def steps(self) -> tuple[float, float]:
        """A pixel's width and height in the plane's units."""
        west, south, east, north = self.bounds
        return (east - west) / self.width, (north - south) / self.height

    @property
    def once_round(self) -> float:
        """The earth's girth in the plane's units; a zone of UTM ends long before."""
        return 2 * HALF_WORLD_M if self.plane != "degrees" else 360.0

    def bounds_of(self, island: EarthIsland) -> Bounds:
        """In the plane's units."""
        if self.zone is not None:
            return bounds_of(self.zone.points(island.outline))
        return island.mercator_bounds if self.plane == "mercator" else island.bounds

    def ground_m(self, latitude_deg: float) -> tuple[float, float]:
        """A pixel's width and height on the ground, in metres."""
        across, down = self.steps
        if self.zone is not None:
            return across, down  # to four parts in ten thousand
        if self.plane == "mercator":
            return across * ground_scale(latitude_deg), down * ground_scale(latitude_deg)
        along_parallel, along_meridian = metres_per_degree(latitude_deg).tolist()
        return across * along_parallel, down * along_meridian


def grid_of_tile(level: int, x: int, y: int) -> PictureGrid:
    """Of an XYZ tile."""
    west, north = tile_corner(level, x, y)
    side = resolution_m(level) * TILE_SIZE
    return PictureGrid("mercator", (west, north - side, west + side, north), TILE_SIZE, TILE_SIZE)
