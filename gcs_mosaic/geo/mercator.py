"""Web Mercator (EPSG:3857), which nearly all maps on screens are drawn in, and its tiles (XYZ)."""

from __future__ import annotations

import math

import numpy as np

from gcs_mosaic.geo.ellipsoid import RADIUS_M, Floats, Places, wrapped

HALF_WORLD_M = math.pi * RADIUS_M
MOST_LATITUDE_DEG = math.degrees(math.atan(math.sinh(math.pi)))  # 85.05: there the square of the world ends
TILE_SIZE = 256
FINEST_LEVEL = 26  # 0.6 mm a pixel


def mercator(places: Places) -> Floats:
    """(..., 2) metres east and north on the map, of places (degrees); latitudes beyond the map's are taken as its edge."""
    latitude = np.radians(np.clip(places[..., 1], -MOST_LATITUDE_DEG, MOST_LATITUDE_DEG))
    east = np.radians(places[..., 0]) * RADIUS_M
    return np.stack([east, RADIUS_M * np.arcsinh(np.tan(latitude))], axis=-1)


def places_of_mercator(points: Floats) -> Places:
    """Longitude and latitude in degrees of (..., 2) metres on the map."""
    longitude = wrapped(np.degrees(points[..., 0] / RADIUS_M))
    return np.stack([longitude, np.degrees(np.arctan(np.sinh(points[..., 1] / RADIUS_M)))], axis=-1)


def resolution_m(level: int) -> float:
    """Metres on the map of a pixel at a level; on the ground they are shorter by `ground_scale`."""
    return 2 * HALF_WORLD_M / TILE_SIZE / (1 << level)


def ground_scale(latitude_deg: float) -> float:
    """Metres on the ground of a metre on the map, as the sphere tells it."""
    return math.cos(math.radians(latitude_deg))


def level_of(ground_m: float, latitude_deg: float) -> int:
    """The level whose pixels are nearest a length on the ground (metres), as factors go."""
    exact = math.log2(2 * HALF_WORLD_M / TILE_SIZE * ground_scale(latitude_deg) / ground_m)
    return min(max(round(exact), 0), FINEST_LEVEL)


def tile_corner(level: int, x: int, y: int) -> tuple[float, float]:
    """Metres on the map of a tile's corner in the north-west."""
    side = resolution_m(level) * TILE_SIZE
    return x * side - HALF_WORLD_M, HALF_WORLD_M - y * side
