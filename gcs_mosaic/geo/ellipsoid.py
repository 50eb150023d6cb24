"""WGS 84: places on the ellipsoid, in space (ECEF), and on a plane that touches the earth at one place (ENU).

Anchors are fitted on such a plane: at 45 degrees north a plane by radii of curvature is 2.2 m off at 5 km from its middle, one
by Mercator and its scale 10.8 m.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

Floats: TypeAlias = npt.NDArray[np.float64]  # any shape
Places: TypeAlias = npt.NDArray[np.float64]  # (..., 2): longitude and latitude in degrees
Spots: TypeAlias = npt.NDArray[np.float64]  # (..., 2): metres east and north of a plane's origin

RADIUS_M = 6378137.0  # half the major axis
FLATTENING = 1 / 298.257223563
ECCENTRICITY_2 = FLATTENING * (2 - FLATTENING)
FURTHEST_M = 500e3  # from a plane's origin: what is further away is no flight's


@dataclass(frozen=True, slots=True)
class LocalPlane:
    """The plane that touches the ellipsoid at a place (degrees)."""

    longitude_deg: float
    latitude_deg: float

    def spots(self, places: Places) -> Spots:
        """East and north (metres) of places on the ellipsoid, seen from space straight down on the plane."""
        spots: Spots = ((ecef(places) - self._origin) @ self._axes)[..., :2]
        return spots

    def places(self, spots: Spots) -> Places:
        """The places on the ellipsoid above or below spots of the plane; not a number beyond `FURTHEST_M`."""
        far = ~(np.hypot(spots[..., 0], spots[..., 1]) <= FURTHEST_M)
        wanted = np.where(far[..., None], 0.0, spots)
        east_north, up = self._axes[:, :2], self._axes[:, 2]
        # A line straight down through the spot, and the nearer of the two points where it passes through the ellipsoid.
        squeezed = np.array([1.0, 1.0, 1 / (1 - FLATTENING)]) / RADIUS_M
        start, way = (self._origin + wanted @ east_north.T) * squeezed, up * squeezed
        half = start @ way / (way @ way)
        rest = ((start**2).sum(axis=-1) - 1) / (way @ way)
        depth = -rest / (half + np.sqrt(half**2 - rest))
        points = self._origin + wanted @ east_north.T + depth[..., None] * up
        found = np.degrees(
            [
                np.arctan2(points[..., 1], points[..., 0]),
                np.arctan2(points[..., 2], (1 - ECCENTRICITY_2) * np.hypot(points[..., 0], points[..., 1])),
            ]
        )
        return np.where(far[..., None], np.nan, np.stack([found[0], found[1]], axis=-1))

    @property
    def _origin(self) -> Floats:
        return ecef(np.array([self.longitude_deg, self.latitude_deg]))

    @property
    def _axes(self) -> Floats:
        """(3, 3): east, north and up in space, a column each."""
        longitude, latitude = math.radians(self.longitude_deg), math.radians(self.latitude_deg)
        east = np.array([-math.sin(longitude), math.cos(longitude), 0.0])
        up = np.array(
            [math.cos(latitude) * math.cos(longitude), math.cos(latitude) * math.sin(longitude), math.sin(latitude)]
        )
        return np.stack([east, np.cross(up, east), up], axis=1)


def ecef(places: Places) -> Floats:
    """Places on the ellipsoid as (..., 3) metres from the middle of the earth."""
    longitude, latitude = np.radians(places[..., 0]), np.radians(places[..., 1])
    normal = RADIUS_M / np.sqrt(1 - ECCENTRICITY_2 * np.sin(latitude) ** 2)
    across = normal * np.cos(latitude)
    axis = normal * (1 - ECCENTRICITY_2) * np.sin(latitude)
    return np.stack([across * np.cos(longitude), across * np.sin(longitude), axis], axis=-1)


def metres_per_degree(latitude_deg: Any) -> Floats:
    """(..., 2): the lengths of a degree of longitude and of latitude at a latitude."""
    latitude = np.radians(np.asarray(latitude_deg, np.float64))
    root = np.sqrt(1 - ECCENTRICITY_2 * np.sin(latitude) ** 2)
    across, along = RADIUS_M / root * np.cos(latitude), RADIUS_M * (1 - ECCENTRICITY_2) / root**3
    return np.radians(np.stack([across, along], axis=-1))


def wrapped(longitude_deg: Any) -> Floats:
    """Longitudes from -180 up to, not including, 180 degrees."""
    return (np.asarray(longitude_deg, np.float64) + 180) % 360 - 180
