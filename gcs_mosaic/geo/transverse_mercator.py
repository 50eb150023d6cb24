"""UTM: the transverse Mercator projection of WGS 84 in zones of six degrees.

Kruger's series in the third flattening to the sixth order, as C. F. F. Karney gives it (Transverse Mercator with an accuracy of a
few nanometers, Journal of Geodesy 85, 2011, equations 7-11 and 35-36).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from gcs_mosaic.geo.ellipsoid import ECCENTRICITY_2, FLATTENING, RADIUS_M, wrapped

SCALE = 0.9996  # at the middle of a zone
FALSE_EASTING_M = 500e3
FALSE_NORTHING_M = 10e6  # south of the equator
LATITUDES_DEG = (-80.0, 84.0)  # of UTM

_N = FLATTENING / (2 - FLATTENING)
_RADIUS_M = RADIUS_M / (1 + _N) * (1 + _N**2 / 4 + _N**4 / 64 + _N**6 / 256)
_FORWARD = (
    _N / 2 - 2 * _N**2 / 3 + 5 * _N**3 / 16 + 41 * _N**4 / 180 - 127 * _N**5 / 288 + 7891 * _N**6 / 37800,
    13 * _N**2 / 48 - 3 * _N**3 / 5 + 557 * _N**4 / 1440 + 281 * _N**5 / 630 - 1983433 * _N**6 / 1935360,
    61 * _N**3 / 240 - 103 * _N**4 / 140 + 15061 * _N**5 / 26880 + 167603 * _N**6 / 181440,
    49561 * _N**4 / 161280 - 179 * _N**5 / 168 + 6601661 * _N**6 / 7257600,
    34729 * _N**5 / 80640 - 3418889 * _N**6 / 1995840,
    212378941 * _N**6 / 319334400,
)
_BACK = (
    _N / 2 - 2 * _N**2 / 3 + 37 * _N**3 / 96 - _N**4 / 360 - 81 * _N**5 / 512 + 96199 * _N**6 / 604800,
    _N**2 / 48 + _N**3 / 15 - 437 * _N**4 / 1440 + 46 * _N**5 / 105 - 1118711 * _N**6 / 3870720,
    17 * _N**3 / 480 - 37 * _N**4 / 840 - 209 * _N**5 / 4480 + 5569 * _N**6 / 90720,
    4397 * _N**4 / 161280 - 11 * _N**5 / 504 - 830251 * _N**6 / 7257600,
    4583 * _N**5 / 161280 - 108847 * _N**6 / 3991680,
    20648693 * _N**6 / 638668800,
)


@dataclass(frozen=True, slots=True)
class UtmPlace:
    """A place in a UTM zone (1 to 60); metres."""

    zone: int
    is_north: bool
    easting_m: float
    northing_m: float


def utm(longitude_deg: float, latitude_deg: float) -> UtmPlace | None:
    """A place in its own zone, Norway's and Svalbard's exceptions included; None where UTM has none, near the poles."""
    if not LATITUDES_DEG[0] <= latitude_deg <= LATITUDES_DEG[1]:
        return None
    zone = zone_of(longitude_deg, latitude_deg)
    easting, northing = projected(longitude_deg, latitude_deg, zone)
    return UtmPlace(zone, latitude_deg >= 0, easting, northing + (0 if latitude_deg >= 0 else FALSE_NORTHING_M))


def place_of_utm(place: UtmPlace) -> tuple[float, float]:
    """Longitude and latitude in degrees."""
    northing = place.northing_m - (0 if place.is_north else FALSE_NORTHING_M)
    xi, eta = northing / (SCALE * _RADIUS_M), (place.easting_m - FALSE_EASTING_M) / (SCALE * _RADIUS_M)
    flat = complex(xi, eta) - sum(factor * _sine(2 * j, xi, eta) for j, factor in enumerate(_BACK, 1))
    conformal = math.sin(flat.real) / math.hypot(math.sinh(flat.imag), math.cos(flat.real))
    longitude = math.degrees(math.atan2(math.sinh(flat.imag), math.cos(flat.real)))
    latitude = math.degrees(math.atan(_tangent(conformal)))
    return float(wrapped(middle_of(place.zone) + longitude)), latitude


def projected(longitude_deg: float, latitude_deg: float, zone: int) -> tuple[float, float]:
    """Easting and northing (metres, negative south of the equator) in a given zone."""
    longitude = math.radians(float(wrapped(longitude_deg - middle_of(zone))))
    tangent = _conformal(math.tan(math.radians(latitude_deg)))
    xi = math.atan2(tangent, math.cos(longitude))
    eta = math.asinh(math.sin(longitude) / math.hypot(tangent, math.cos(longitude)))
    flat = complex(xi, eta) + sum(factor * _sine(2 * j, xi, eta) for j, factor in enumerate(_FORWARD, 1))
    return FALSE_EASTING_M + SCALE * _RADIUS_M * flat.imag, SCALE * _RADIUS_M * flat.real


def middle_of(zone: int) -> float:
    """The longitude (degrees) in the middle of a zone."""
    return zone * 6.0 - 183.0


def zone_of(longitude_deg: float, latitude_deg: float) -> int:
    """The zone that is used at a place."""
    longitude = float(wrapped(longitude_deg))
    if 56 <= latitude_deg < 64 and 3 <= longitude < 12:  # the west coast of Norway
        return 32
    if 72 <= latitude_deg <= 84 and 0 <= longitude < 42:  # Svalbard
        return 31 + 2 * int((longitude + 3) // 12)
    return int((longitude + 180) // 6) + 1


def _sine(factor: int, xi: float, eta: float) -> complex:
    """The series' terms: the sine of a complex number."""
    return complex(
        math.sin(factor * xi) * math.cosh(factor * eta),
        math.cos(factor * xi) * math.sinh(factor * eta),
    )


def _conformal(tangent: float) -> float:
    """The tangent of the conformal latitude, of that of the latitude."""
    eccentricity = math.sqrt(ECCENTRICITY_2)
    root = math.hypot(1, tangent)
    sigma = math.sinh(eccentricity * math.atanh(eccentricity * tangent / root))
    return tangent * math.hypot(1, sigma) - sigma * root


def _tangent(conformal: float) -> float:
    """The tangent of the latitude, of that of the conformal latitude, by Newton's method: four rounds reach the last digit."""
    found = conformal / (1 - ECCENTRICITY_2)
    for _ in range(6):
        missed = conformal - _conformal(found)
        slope = (1 + (1 - ECCENTRICITY_2) * found**2) / (
            (1 - ECCENTRICITY_2) * math.hypot(1, _conformal(found)) * math.hypot(1, found)
        )
        found += missed * slope
    return found
