"""Coordinates as people write them: decimal degrees, degrees-minutes-seconds, UTM and MGRS; WGS 84 always."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace

from gcs_mosaic.errors import UsageError
from gcs_mosaic.geo.transverse_mercator import UtmPlace, place_of_utm, utm

LONGEST = 100  # characters
BANDS = "CDEFGHJKLMNPQRSTUVWX"  # of 8 degrees of latitude, from 80 south; the last has 12
COLUMNS = ("ABCDEFGH", "JKLMNPQR", "STUVWXYZ")  # MGRS: of 100 km from easting 100 km, by zone modulo 3
ROWS = "ABCDEFGHJKLMNPQRSTUV"  # MGRS: of 100 km of northing; begins with F in even zones
SQUARE_M = 100_000
WANTED = (
    'wanted: latitude and longitude ("44.51234, 7.12345", "44 30 12.3 N, 7 7 24.4 E"), '
    'UTM ("32T 350123 4930456"), MGRS ("32TLQ 50123 30456")'
)

_UTM = re.compile(r"(\d{1,2})\s*([A-Z])\s+(\d{6}(?:\.\d+)?)\s*(?:M?E)?[\s,]+(\d{1,8}(?:\.\d+)?)\s*(?:M?N)?", re.ASCII)
_MGRS = re.compile(
    r"(\d{1,2})\s*([C-HJ-NP-X])\s*([A-HJ-NP-Z])\s*([A-HJ-NP-V])\s*(\d{0,10}|\d{1,5}\s+\d{1,5})", re.ASCII
)
_DECIMAL_COMMA = re.compile(r"(?<=\d),(?=\d)", re.ASCII)
_NUMBER = r"(\d+(?:\.\d+)?)"
_ANGLE = re.compile(
    rf"([NSEW])?\s*([+-]?\d+(?:\.\d+)?)\s*°?(?:\s*{_NUMBER}\s*'?(?!'))?(?:\s*{_NUMBER}\s*(?:\"|'')?)?\s*([NSEW])?",
    re.ASCII,
)
# What is told beside a coordinate on the page, in a message of a find and by other programs.
_WITHIN = re.compile(r"\s*(?:±|\+/-|\(WITHIN)\s*(\d{1,5}(?:[.,]\d+)?) ?M\b.*", re.ASCII)
# RFC 5870: a height and parameters may follow.
_GEO = re.compile(r"GEO: ?([^,;?]+,[^,;?]+)(?:,[^;?]*)?(?:[;?].*)?", re.ASCII)
_UNCERTAINTY = re.compile(r";U=(\d{1,5}(?:\.\d+)?)\b", re.ASCII)
_ENCLOSED = re.compile(r"\((.+)\)|\[(.+)\]", re.ASCII)
_SIGMAS = 2.448  # within which 95 % lie, in a plane
_SAME = str.maketrans(
    {"º": "°", "˚": "°", "′": "'", "’": "'", "‘": "'", "″": '"', "”": '"', "“": '"', "−": "-", "–": "-"}
)


@dataclass(frozen=True, slots=True)
class Coordinate:
    """A place on earth in degrees; `precision_m`: half of the last digit that was given, or more if it is told beside it."""

    longitude_deg: float
    latitude_deg: float
    precision_m: float

    @property
    def least_sigma_m(self) -> float:
        """One standard deviation of what was rounded away, in each direction; to a centimetre."""
        return round(self.precision_m / math.sqrt(3), 2)


def read_coordinate(text: str) -> Coordinate:
    """The place that somebody has written. Raises UsageError, which says what came and what is wanted."""
    told = " ".join(text.translate(_SAME).upper().split())
    if not told or len(text) > LONGEST:
        raise UsageError(f"A coordinate is to have 1 to {LONGEST} characters; {WANTED}.")
    told, within_m = _bare(told)
    found = _read(text, _with_points(told))
    return replace(found, precision_m=max(found.precision_m, within_m / _SIGMAS * math.sqrt(3)))


def _bare(told: str) -> tuple[str, float]:
    """A coordinate that was copied, without what is told beside it; and how far off it may be (95 %), metres."""
    within = _WITHIN.search(told) or _UNCERTAINTY.search(told)
    told = _WITHIN.sub("", told)
    if (geo := _GEO.fullmatch(told)) is not None:
        told = geo.group(1)
    if (enclosed := _ENCLOSED.fullmatch(told)) is not None:
        told = (enclosed.group(1) or enclosed.group(2)).strip()
    return told, float(within.group(1).replace(",", ".")) if within else 0.0


def _read(text: str, told: str) -> Coordinate:
    """`told`: what is read of the text. Raises UsageError."""
    if (found := _UTM.fullmatch(told)) is not None:
        return _of_utm(text, *found.groups())
    if (found := _MGRS.fullmatch(told)) is not None:
        return _of_mgrs(text, *found.groups())
    return _of_angles(text, told)


def _with_points(told: str) -> str:
    """Decimal commas, of which there are two or more, as points; a single one stands between latitude and longitude."""
    is_european = "." not in told and len(_DECIMAL_COMMA.findall(told)) > 1
    return _DECIMAL_COMMA.sub(".", told) if is_european else told


def decimal_text(longitude_deg: float, latitude_deg: float) -> str:
    """Latitude and longitude to a decimetre."""
    return f"{latitude_deg:.6f}, {longitude_deg:.6f}"


def dms_text(longitude_deg: float, latitude_deg: float) -> str:
    """Degrees, minutes and seconds to a few decimetres."""
    return f"{_dms(latitude_deg, 'NS')} {_dms(longitude_deg, 'EW')}"


def utm_text(longitude_deg: float, latitude_deg: float) -> str | None:
    """Zone, band, easting and northing in whole metres; None near the poles."""
    place = utm(longitude_deg, latitude_deg)
    if place is None:
        return None
    return f"{place.zone}{band_of(latitude_deg)} {place.easting_m:.0f} {place.northing_m:.0f}"


def mgrs_text(longitude_deg: float, latitude_deg: float) -> str | None:
    """To the metre, as the square that the place is in; None near the poles."""
    place = utm(longitude_deg, latitude_deg)
    if place is None:
        return None
    east, north = math.floor(place.easting_m), math.floor(place.northing_m)
    column = COLUMNS[(place.zone - 1) % 3][east // SQUARE_M - 1]
    row = ROWS[(north // SQUARE_M + _first_row(place.zone)) % len(ROWS)]
    band = band_of(latitude_deg)
    return f"{place.zone}{band}{column}{row} {east % SQUARE_M:05d} {north % SQUARE_M:05d}"


def band_of(latitude_deg: float) -> str:
    """The letter of a band of latitude."""
    return BANDS[min(max(int((latitude_deg + 80) // 8), 0), len(BANDS) - 1)]


def _of_utm(text: str, zone: str, letter: str, easting: str, northing: str) -> Coordinate:
    number, north = _zone(text, zone), float(northing)
    if letter not in BANDS:
        raise UsageError(f'"{text}": UTM has no band {letter}; {WANTED}.')
    if not (100e3 <= float(easting) < 900e3 and 0 <= north <= 10e6):
        raise UsageError(f'"{text}": UTM has eastings from 100000 to 900000 and northings up to 10000000; {WANTED}.')
    # An S after the zone is the band from 32 to 40 degrees north or, as many write it, south of the equator.
    is_north = letter >= "N" and not (letter == "S" and not 3.5e6 <= north <= 4.5e6)
    longitude, latitude = place_of_utm(UtmPlace(number, is_north, float(easting), north))
    if letter not in "NS" and abs(BANDS.index(letter) - BANDS.index(band_of(latitude))) > 1:
        raise UsageError(f'"{text}": this northing is not in band {letter}; {WANTED}.')
    return _checked(text, longitude, latitude, _half_digit(northing))


def _of_mgrs(text: str, zone: str, band: str, column: str, row: str, digits: str) -> Coordinate:
    number = _zone(text, zone)
    east, north = digits.split() if " " in digits else (digits[: len(digits) // 2], digits[len(digits) // 2 :])
    columns = COLUMNS[(number - 1) % 3]
    if len(east) != len(north) or column not in columns:
        raise UsageError(
            f'"{text}": MGRS has as many digits east as north, and zone {number} columns {columns}; {WANTED}.'
        )
    half = SQUARE_M / 10 ** len(east) / 2  # the middle of the square that is named
    easting = (columns.index(column) + 1) * SQUARE_M + 2 * half * int(east or 0) + half
    within = ((ROWS.index(row) - _first_row(number)) % len(ROWS)) * SQUARE_M + 2 * half * int(north or 0) + half
    is_north = band >= "N"
    for northing in (within + turn * len(ROWS) * SQUARE_M for turn in range(5)):
        longitude, latitude = place_of_utm(UtmPlace(number, is_north, easting, northing))
        if _is_in_band(band, latitude):
            return _checked(text, longitude, latitude, half)
    raise UsageError(f'"{text}": row {row} does not occur in band {band} of zone {number}; {WANTED}.')


def _of_angles(text: str, told: str) -> Coordinate:
    first, second = _split(text, told)
    if first.axis == "longitude" or second.axis == "latitude":
        first, second = second, first
    if first.axis == "longitude" or second.axis == "latitude":
        raise UsageError(f'"{text}" has two longitudes or two latitudes; {WANTED}.')
    if not abs(first.degrees) <= 90:
        raise UsageError(f'"{text}": a latitude is from -90 to 90 degrees, and comes first; {WANTED}.')
    if not abs(second.degrees) <= 180:
        raise UsageError(f'"{text}": a longitude is from -180 to 180 degrees; {WANTED}.')
    # Programs leave out zeros at the end of one of the two: what is given of the other is how exact both are.
    return _checked(text, second.degrees, first.degrees, min(first.half, second.half) * 111_320.0)


@dataclass(frozen=True, slots=True)
class _Angle:
    degrees: float
    half: float  # of the last digit, degrees
    axis: str | None  # by its letter


def _split(text: str, told: str) -> tuple[_Angle, _Angle]:
    """The two angles of a text: at a comma, after or before a letter, or in the middle of its numbers."""
    parts = [part for part in re.split(r"[,;]", told) if part.strip()]
    if len(parts) != 2 and len(parts) == 1:
        parts = _halves(told)
    angles = [_angle(part) for part in parts] if len(parts) == 2 else []
    if len(angles) != 2 or angles[0] is None or angles[1] is None:
        raise UsageError(f'"{text}" is no coordinate that is understood; {WANTED}.')
    return angles[0], angles[1]


def _halves(told: str) -> list[str]:
    if (found := re.fullmatch(r"([^NSEW]+[NSEW])\s*([^NSEW]+[NSEW])", told)) is not None:
        return list(found.groups())
    if (found := re.fullmatch(r"([NSEW][^NSEW]+)([NSEW][^NSEW]+)", told)) is not None:
        return list(found.groups())
    words = told.split()
    return [" ".join(words[: len(words) // 2]), " ".join(words[len(words) // 2 :])] if len(words) % 2 == 0 else []


def _angle(part: str) -> _Angle | None:
    found = _ANGLE.fullmatch(part.strip())
    if found is None:
        return None
    before, *written, after = found.groups()
    letters = [letter for letter in (before, after) if letter]
    numbers = [number for number in written if number is not None]
    if len(letters) > 1:
        return None
    if any("." in number for number in numbers[:-1]) or any(float(number) >= 60 for number in numbers[1:]):
        return None
    if letters and numbers[0][0] in "+-":
        return None
    size = sum(abs(float(number)) / 60**at for at, number in enumerate(numbers))
    is_negative = numbers[0].startswith("-") or letters in (["S"], ["W"])
    axis = {"N": "latitude", "S": "latitude", "E": "longitude", "W": "longitude"}[letters[0]] if letters else None
    half = _half_digit(numbers[-1]) / 60 ** (len(numbers) - 1)
    return _Angle(-size if is_negative else size, half, axis)


def _checked(text: str, longitude: float, latitude: float, precision: float) -> Coordinate:
    if (round(longitude, 6), round(latitude, 6)) == (0, 0):
        raise UsageError(f'"{text}": no flight is at 0, 0; it is what receivers tell that know no place.')
    return Coordinate(longitude, latitude, precision)


def _zone(text: str, zone: str) -> int:
    if not 1 <= int(zone) <= 60:
        raise UsageError(f'"{text}": UTM has zones 1 to 60; {WANTED}.')
    return int(zone)


def _half_digit(number: str) -> float:
    """Half of the last digit that is written."""
    return float(0.5 * 10.0 ** -(len(number.partition(".")[2])))


def _is_in_band(band: str, latitude: float) -> bool:
    """Whether a latitude is in a band, or so little beside it that a square of 100 km reaches in."""
    low = -80 + 8 * BANDS.index(band)
    return low - 1 <= latitude <= low + (12 if band == "X" else 8) + 1


def _first_row(zone: int) -> int:
    return 5 if zone % 2 == 0 else 0


def _dms(degrees: float, letters: str) -> str:
    tenths = round(abs(degrees) * 36_000)
    whole, rest = divmod(tenths, 36_000)
    minutes, seconds = divmod(rest, 600)
    return f"{whole}°{minutes:02d}'{seconds / 10:04.1f}\"{letters[degrees < 0]}"
