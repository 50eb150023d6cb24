"""The arithmetic of the earth, against PROJ."""

from __future__ import annotations

import numpy as np
import pytest
from pyproj import Transformer

from gcs_mosaic.geo.ellipsoid import FURTHEST_M, Floats, LocalPlane, ecef, metres_per_degree
from gcs_mosaic.geo.mercator import level_of, mercator, places_of_mercator, resolution_m, tile_corner
from gcs_mosaic.geo.transverse_mercator import place_of_utm, utm

CHANCE = np.random.default_rng(1)
PLACES: Floats = np.stack([CHANCE.uniform(-180, 180, 500), CHANCE.uniform(-79, 83, 500)], axis=1)


def test_places_in_space_agree_with_proj() -> None:
    expected = Transformer.from_crs(4979, 4978, always_xy=True).transform(
        PLACES[:, 0], PLACES[:, 1], np.zeros(len(PLACES))
    )
    assert np.abs(ecef(PLACES) - np.stack(expected, axis=1)).max() < 1e-6


@pytest.mark.parametrize("place", [(7.0, 44.5), (-179.9999, -60.0), (100.0, 0.0), (0.0, 89.0)])
def test_a_plane_agrees_with_proj_and_leads_back(place: tuple[float, float]) -> None:
    spots = np.random.default_rng(2).uniform(-2e4, 2e4, (200, 2))
    plane = LocalPlane(*place)
    found = plane.places(spots)
    back = Transformer.from_pipeline(
        f"+proj=pipeline +step +proj=cart +ellps=WGS84 +step +proj=topocentric +ellps=WGS84 +lon_0={place[0]} +lat_0={place[1]}"
    )
    east, north, _ = back.transform(
        np.radians(found[:, 0]), np.radians(found[:, 1]), np.zeros(len(found)), radians=True
    )
    assert np.hypot(east - spots[:, 0], north - spots[:, 1]).max() < 1e-3
    assert np.abs(plane.spots(found) - spots).max() < 1e-6


def test_too_far_from_a_plane_is_no_place() -> None:
    found = LocalPlane(7.0, 44.5).places(np.array([[FURTHEST_M + 1, 0.0], [1.0, 1.0], [np.nan, 0.0]]))
    assert np.isfinite(found).all(axis=1).tolist() == [False, True, False]


def test_web_mercator_agrees_with_proj_and_leads_back() -> None:
    expected = Transformer.from_crs(4326, 3857, always_xy=True).transform(*PLACES.T)
    assert np.abs(mercator(PLACES) - np.stack(expected, axis=1)).max() < 1e-6
    assert np.abs(places_of_mercator(mercator(PLACES)) - PLACES).max() < 1e-9


def test_utm_agrees_with_proj_and_leads_back() -> None:
    for longitude, latitude in PLACES[:60]:
        place = utm(longitude, latitude)
        assert place is not None
        zones = 32600 if place.is_north else 32700
        expected = Transformer.from_crs(4326, zones + place.zone, always_xy=True).transform(longitude, latitude)
        assert np.hypot(place.easting_m - expected[0], place.northing_m - expected[1]) < 1e-6
        assert place_of_utm(place) == pytest.approx((longitude, latitude), abs=1e-9)


@pytest.mark.parametrize(("longitude", "latitude", "zone"), [(5.0, 60.0, 32), (10.0, 75.0, 33), (-180.0, 0.0, 1)])
def test_zones_and_their_exceptions(longitude: float, latitude: float, zone: int) -> None:
    place = utm(longitude, latitude)
    assert place is not None
    assert place.zone == zone


def test_degrees_have_their_lengths() -> None:
    assert metres_per_degree(0.0) == pytest.approx([111319.49, 110574.28], abs=0.01)
    assert metres_per_degree(45.0) == pytest.approx([78846.81, 111131.75], abs=0.1)


def test_levels_of_tiles() -> None:
    assert resolution_m(0) == pytest.approx(156543.03, abs=0.01)
    assert [level_of(ground, 44.5) for ground in (0.01, 0.05, 2.0, 1e-9, 1e9)] == [23, 21, 16, 26, 0]
    assert tile_corner(1, 1, 1) == (0.0, 0.0)
