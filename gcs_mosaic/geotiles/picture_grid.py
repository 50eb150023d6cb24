"""Where the pixels of a picture of the earth lie: on Web Mercator (EPSG:3857) or on longitude and latitude (EPSG:4326)."""

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
from gcs_mosaic.geotiles.earth_islands import Bounds, EarthIsland


@dataclass(frozen=True, slots=True)
class PictureGrid:
    """A picture, north up: its bounds in metres of Mercator or in degrees, and its size in pixels."""

    plane: Literal["mercator", "degrees"]
    bounds: Bounds
    width: int
    height: int

    def places(self, columns: Floats, rows: Floats) -> Places:
        """(rows, columns, 2) degrees at edges of pixels, counted from the left and from the top."""
        west, _, _, north = self.bounds
        across, down = self.steps
        x, y = np.meshgrid(west + columns * across, north - rows * down)
        points = np.stack([x, y], axis=-1)
        return places_of_mercator(points) if self.plane == "mercator" else points

    @property
    def steps(self) -> tuple[float, float]:
        """A pixel's width and height in the plane's units."""
        west, south, east, north = self.bounds
        return (east - west) / self.width, (north - south) / self.height

    @property
    def once_round(self) -> float:
        """The earth's girth in the plane's units."""
        return 2 * HALF_WORLD_M if self.plane == "mercator" else 360.0

    def bounds_of(self, island: EarthIsland) -> Bounds:
        """In the plane's units."""
        return island.mercator_bounds if self.plane == "mercator" else island.bounds

    def ground_m(self, latitude_deg: float) -> tuple[float, float]:
        """A pixel's width and height on the ground, in metres."""
        across, down = self.steps
        if self.plane == "mercator":
            return across * ground_scale(latitude_deg), down * ground_scale(latitude_deg)
        along_parallel, along_meridian = metres_per_degree(latitude_deg).tolist()
        return across * along_parallel, down * along_meridian


def grid_of_tile(level: int, x: int, y: int) -> PictureGrid:
    """Of an XYZ tile."""
    west, north = tile_corner(level, x, y)
    side = resolution_m(level) * TILE_SIZE
    return PictureGrid("mercator", (west, north - side, west + side, north), TILE_SIZE, TILE_SIZE)
