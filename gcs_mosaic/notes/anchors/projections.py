"""The first line of a list of control points: what its coordinates are in. WGS 84 alone, and what is within a metre of it."""

from __future__ import annotations

import math
import re
from collections.abc import Callable

from gcs_mosaic.errors import UsageError
from gcs_mosaic.geo.ellipsoid import RADIUS_M
from gcs_mosaic.geo.transverse_mercator import UtmPlace, place_of_utm
from gcs_mosaic.notes.storage.checked import number_of

Project = Callable[[float, float], tuple[float, float]]  # to longitude and latitude in degrees

EASTINGS_M, NORTHINGS_M = (0.0, 1e6), (-10e6, 10e6)  # of UTM; some count negative northings south of the equator
IN_DEGREES = (4326, 4979, 4258)  # of WGS 84 and ETRS89
WEB_MERCATOR = 3857
HALF_WORLD_M = math.pi * RADIUS_M
_EPSG = re.compile(r"(?:\+init=)?EPSG\s*:{0,2}\s*(\d{4,6})\b.{0,200}", re.ASCII | re.IGNORECASE)
_UTM_WORDS = re.compile(
    r"(?:(?:WGS|ETRS)[ _-]?(?:19)?8[49]\s*[/,]?\s*)?UTM[\s,]*(?:zone)?[\s:]*(\d{1,2})\s*([NS])\b.{0,20}",
    re.ASCII | re.IGNORECASE,
)
_DEGREE_WORDS = re.compile(
    r"(?:WGS[ _-]?(?:19)?84)(?:\s*(?:lat|lon|long|geographic|degrees|/|\(.*\)).*)?", re.ASCII | re.IGNORECASE
)
_PROJ = re.compile(r"\+proj=utm\b.*?\+zone=(\d{1,2})", re.ASCII)
_OTHER = re.compile(
    r"\+(?:datum|ellps)=(?!WGS84\b|GRS80\b)\S+|\+units=(?!m\b)\S+|\+towgs84=(?!0(?:\.0*)?(?:,0(?:\.0*)?)*(?:\s|$))\S+",
    re.ASCII,
)


def projection_of(line: str) -> Project | None:
    """What a line names; None where it names nothing of the kind. Raises UsageError for what is not understood."""
    told = line.strip().strip("\"'").strip(",; \t")
    if (found := _EPSG.fullmatch(told)) is not None:
        return _of_epsg(int(found[1]), told)
    if (found := _UTM_WORDS.fullmatch(told)) is not None:
        return _utm_zone(int(found[1]), is_north=found[2].upper() == "N")
    if _DEGREE_WORDS.fullmatch(told):
        return _degrees
    return _of_proj(told) if told.startswith("+proj=") else None


def _of_proj(told: str) -> Project:
    if (other := _OTHER.search(told)) is not None:
        raise UsageError(
            f"{other[0]} is not understood: give coordinates of WGS 84, in degrees or in a UTM zone in metres."
        )
    if (found := _PROJ.match(told)) is not None:
        return _utm_zone(int(found[1]), is_north="+south" not in told)
    if told.startswith(("+proj=longlat", "+proj=latlong")):
        return _degrees
    raise UsageError(
        f"{told[:80]} is not understood: give coordinates of WGS 84, in degrees or in a UTM zone in metres."
    )


def _of_epsg(code: int, told: str) -> Project:
    if code in IN_DEGREES:
        return _degrees
    if code == WEB_MERCATOR:
        return _of_web_mercator
    if 32601 <= code <= 32660 or 32701 <= code <= 32760:
        return _utm_zone(code % 100, is_north=code < 32700)
    if 25828 <= code <= 25838:  # ETRS89
        return _utm_zone(code % 100, is_north=True)
    raise UsageError(
        f"{told[:80]} is not understood: "
        "give coordinates as EPSG:4326 (longitude, latitude) or in a UTM zone (EPSG:326.., 327..)."
    )


def _utm_zone(zone: int, *, is_north: bool) -> Project:
    if not 1 <= zone <= 60:
        raise UsageError(f"UTM has zones 1 to 60, not {zone}.")

    def place(east: float, north: float) -> tuple[float, float]:
        east, north = number_of(east, "an easting", *EASTINGS_M), number_of(north, "a northing", *NORTHINGS_M)
        return place_of_utm(UtmPlace(zone, is_north, east, north))

    return place


def _degrees(longitude: float, latitude: float) -> tuple[float, float]:
    return longitude, latitude


def _of_web_mercator(east: float, north: float) -> tuple[float, float]:
    east, north = (number_of(one, "a coordinate of Web Mercator", -HALF_WORLD_M, HALF_WORLD_M) for one in (east, north))
    return math.degrees(east / RADIUS_M), math.degrees(math.atan(math.sinh(north / RADIUS_M)))
