"""The series of the transverse Mercator projection, against the integrals that they stand for."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gcs_mosaic.errors import UsageError
from gcs_mosaic.geo import transverse_mercator as module
from gcs_mosaic.geo.coordinates import BANDS, Coordinate, band_of, dms_text, mgrs_text, read_coordinate, utm_text
from gcs_mosaic.geo.ellipsoid import ECCENTRICITY_2, RADIUS_M, Floats, wrapped
from gcs_mosaic.geo.transverse_mercator import UtmPlace, place_of_utm, projected, utm, zone_of

COUNT = 64  # places along a quarter of a meridian: of terms up to the twelfth a sum over so many is exact
NODES, WEIGHTS = np.polynomial.legendre.leggauss(80)


def arc(latitude: float) -> float:
    """Length of the meridian from the equator, in half major axes."""
    at = latitude * (NODES + 1) / 2
    return math.fsum(WEIGHTS * (1 - ECCENTRICITY_2) / (1 - ECCENTRICITY_2 * np.sin(at) ** 2) ** 1.5) * latitude / 2


def conformal(latitude: float) -> float:
    eccentricity, sine = math.sqrt(ECCENTRICITY_2), math.sin(latitude)
    return math.atan(math.sinh(math.asinh(math.tan(latitude)) - eccentricity * math.atanh(eccentricity * sine)))


QUARTER = arc(math.pi / 2)


def latitude_where(angle: float, of: str) -> float:
    """The latitude (radians) whose conformal or rectifying latitude is this."""
    found = angle
    for _ in range(60):
        now = conformal(found) if of == "conformal" else arc(found) / QUARTER * math.pi / 2
        found += angle - now
    return found


def coefficients(of: str) -> Floats:
    """Of the sines of 2, 4, ... 12 times the one latitude in the other less it, as Fourier found them."""
    angles = (np.arange(COUNT) + 0.5) * math.pi / 2 / COUNT
    differ = []
    for angle in angles.tolist():
        latitude = latitude_where(angle, of)
        other = arc(latitude) / QUARTER * math.pi / 2 if of == "conformal" else conformal(latitude)
        differ.append(other - angle)
    rows = [math.fsum(np.array(differ) * np.sin(2 * j * angles)) * 2 / COUNT for j in range(1, 7)]
    return np.array(rows)


def test_the_series_forwards_is_that_of_the_integrals() -> None:
    assert np.abs(coefficients("conformal") - module._FORWARD).max() < 6e-17


def test_the_series_back_is_that_of_the_integrals() -> None:
    assert np.abs(coefficients("rectifying") + module._BACK).max() < 6e-17


def test_the_radius_is_that_of_a_circle_as_long_as_a_meridian() -> None:
    assert pytest.approx(RADIUS_M * QUARTER * 2 / math.pi, rel=4e-16) == module._RADIUS_M


@pytest.mark.parametrize(
    ("longitude", "latitude", "zone"),
    [
        (3.0, 56.0, 32), (2.9, 56.0, 31), (3.0, 55.9, 31), (5.9, 63.9, 32), (5.0, 64.0, 31), (11.9, 60.0, 32), (12.0, 60.0, 33),
        (0.0, 72.0, 31), (8.9, 72.0, 31), (9.0, 72.0, 33), (20.9, 84.0, 33), (21.0, 84.0, 35), (32.9, 80.0, 35),
        (33.0, 80.0, 37), (41.9, 80.0, 37), (42.0, 80.0, 38), (9.0, 71.9, 32), (-0.1, 75.0, 30),
        (179.9, 0.0, 60), (180.0, 0.0, 1), (-174.0, 0.0, 2), (-0.1, 0.0, 30), (0.0, 0.0, 31),
    ],
)  # fmt: skip
def test_a_zone_begins_where_it_begins(longitude: float, latitude: float, zone: int) -> None:
    assert zone_of(longitude, latitude) == zone


def test_utm_ends_beside_the_poles() -> None:
    assert [utm(9.0, latitude) is None for latitude in (-80.01, -80.0, 84.0, 84.01)] == [True, False, False, True]


def test_the_equator_is_in_the_north_and_the_south_counts_from_ten_thousand_kilometres() -> None:
    north, south = utm(9.0, 0.0), utm(9.0, -1e-9)
    assert north is not None
    assert south is not None
    assert (north.is_north, north.easting_m, north.northing_m) == (True, 500e3, 0.0)
    assert not south.is_north
    assert south.northing_m == pytest.approx(10e6, abs=1e-3)
    assert place_of_utm(south) == pytest.approx((9.0, -1e-9), abs=1e-11)
    assert projected(9.0, -45.0, 32)[1] == -projected(9.0, 45.0, 32)[1]


def test_a_place_is_told_in_a_zone_that_is_not_its_own() -> None:
    easting, northing = projected(179.5, 40.0, 1)
    assert easting < 500e3
    assert place_of_utm(UtmPlace(1, True, easting, northing)) == pytest.approx((179.5, 40.0), abs=1e-11)
    assert wrapped([180.0, 179.9, -180.0, 540.0]).tolist() == [-180.0, pytest.approx(179.9), -180.0, -180.0]


@pytest.mark.parametrize(
    ("latitude", "band"),
    [
        (-80, "C"),
        (-72.1, "C"),
        (-72, "D"),
        (-0.1, "M"),
        (0, "N"),
        (7.9, "N"),
        (8, "P"),
        (71.9, "W"),
        (72, "X"),
        (84, "X"),
    ],
)
def test_a_band_begins_each_eight_degrees(latitude: float, band: str) -> None:
    assert band_of(latitude) == band


@pytest.mark.parametrize("latitude", [-79.9, -40.5, -8.2, -0.1, 0.1, 33.0, 71.9, 83.9])
@pytest.mark.parametrize("longitude", [-179.9, -60.2, 2.9, 3.1, 9.0, 11.99, 101.0])
def test_squares_of_all_sets_are_read_as_they_are_written(longitude: float, latitude: float) -> None:
    for text in (mgrs_text(longitude, latitude), utm_text(longitude, latitude)):
        assert text is not None
        found = read_coordinate(text)
        assert found.latitude_deg == pytest.approx(latitude, abs=2e-5)
        assert (found.longitude_deg - longitude) * math.cos(math.radians(latitude)) == pytest.approx(0.0, abs=2e-5)


@pytest.mark.parametrize(
    "text",
    [
        "32T 99999.9 4649776", "32T 900000 4649776", "32N 500000 10000001", "0T 500000 4649776", "61T 500000 4649776",
        "32X 500000 4649776", "32TAA 00000 49776", "32TNM 0000 00000", "90.1, 7", "-90.1, 7", "7 E, 90.1 N", "44, 180.1",
        "44, -180.1", "44 60, 7 0", "44 0 60, 7 0 0", "0.0000004, 0.0000004", "+44 N, 7 E", "44 N 7", "a, b",
        "N44.5S, 7 E", "N 44.5 N, 7 E",
    ],
)  # fmt: skip
def test_what_is_just_beyond_is_refused(text: str) -> None:
    with pytest.raises(UsageError):
        read_coordinate(text)


@pytest.mark.parametrize(
    ("text", "latitude", "longitude"),
    [
        ("90, 180", 90.0, 180.0),
        ("-90, -180", -90.0, -180.0),
        ("44 59, 7 59.9", 44 + 59 / 60, 7 + 59.9 / 60),
        ("0.000001, 0", 0.000001, 0.0),
        ("+44.5, -7.5", 44.5, -7.5),
        ("N 44.5, E 7.5", 44.5, 7.5),
        ("32N 100000 0", 0.0, 5.4),
        ("32M 500000 9999999", -0.00001, 9.0),
        ("1N 500000 1", 0.00001, -177.0),
        ("60N 500000 1", 0.00001, 177.0),
        ("x" * 0 + "44.5,7.5" + " " * 92, 44.5, 7.5),
    ],
)
def test_what_is_just_within_is_read(text: str, latitude: float, longitude: float) -> None:
    found = read_coordinate(text)
    assert (found.latitude_deg, found.longitude_deg) == pytest.approx((latitude, longitude), abs=0.02)


@pytest.mark.parametrize(
    ("text", "half_m"),
    [
        ("44.5 7.12345", 0.5566), ("44 30 12.5 N, 7 7 24.4 E", 1.546), ("44 30 N, 7 7 E", 927.7), ("44, 7", 55660.0),
        ("32T 500000 4649776", 0.5), ("32T 500000.0 4649776.25", 0.005), ("32TNM", 50000.0), ("32TNM 0 4", 5000.0),
        ("32TNM 00000 49776", 0.5),
    ],
)  # fmt: skip
def test_half_of_the_last_digit_is_how_exact_it_is(text: str, half_m: float) -> None:
    assert read_coordinate(text).precision_m == pytest.approx(half_m, rel=0.01)


def test_what_was_rounded_away_has_a_deviation() -> None:
    assert Coordinate(7.0, 44.0, 0.5).least_sigma_m == 0.29


@pytest.mark.parametrize(
    ("longitude", "latitude", "text"),
    [
        (7.0, 44.5, "44°30'00.0\"N 7°00'00.0\"E"),
        (-7.51, -44.999999, "45°00'00.0\"S 7°30'36.0\"W"),
        (0.0, 0.0, "0°00'00.0\"N 0°00'00.0\"E"),
        (100.016389, 9.000278, "9°00'01.0\"N 100°00'59.0\"E"),
    ],
)
def test_degrees_minutes_and_seconds_are_carried(longitude: float, latitude: float, text: str) -> None:
    assert dms_text(longitude, latitude) == text


def test_bands_are_told_apart_where_they_touch() -> None:
    """A northing is in its band, or so little beside it that a square reaches in."""
    for band, northing in (("T", 4430000), ("T", 5316000), ("S", 4430000)):
        assert band in BANDS
        assert read_coordinate(f"32{band} 500000 {northing}").latitude_deg == pytest.approx(northing / 111_000, abs=0.3)
    with pytest.raises(UsageError):
        read_coordinate("32V 500000 4430000")


@pytest.mark.parametrize(
    ("text", "same"),
    [("32TNM0123449776", "32TNM 01234 49776"), ("32TNM1249", "32TNM 12 49"), ("32 T NM 1249", "32TNM 12 49")],
)
def test_the_digits_of_a_square_need_no_space(text: str, same: str) -> None:
    assert read_coordinate(text) == read_coordinate(same)
    with pytest.raises(UsageError):
        read_coordinate(f"{text}0")
