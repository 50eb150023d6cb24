"""Files of control points: pixels of original frames, or places of the map, whose coordinates somebody has measured.

Two forms are read: a table with a heading (CSV, with commas, semicolons or tabs), and OpenDroneMap's `gcp_list.txt`.
"""

from __future__ import annotations

import csv
import errno
import io
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from gcs_mosaic.errors import UsageError
from gcs_mosaic.geo.coordinates import read_coordinate
from gcs_mosaic.geo.pins import USUAL_SIGMA_M
from gcs_mosaic.geo.transverse_mercator import UtmPlace, place_of_utm
from gcs_mosaic.notes.checked import FURTHEST, LONGEST_LABEL, Unfit, number_of, text_of
from gcs_mosaic.notes.pins import MOST_PINS
from gcs_mosaic.store import inside

LARGEST_BYTES = 1 << 20
SIGMAS_M = (0.01, 1000.0)
MOST_PX = float(1 << 20)
# Names of columns, the first of each being ours.
COLUMNS = {
    "name": ("name", "label", "gcp", "point", "id"),
    "frame": ("frame", "image", "image_name", "file"),
    "px": ("px", "im_x", "image_x", "column"),
    "py": ("py", "im_y", "image_y", "row"),
    "island": ("island",),
    "x": ("x", "canvas_x"),
    "y": ("y", "canvas_y"),
    "coordinate": ("coordinate",),
    "latitude": ("latitude", "lat"),
    "longitude": ("longitude", "lon", "lng", "long"),
    "sigma_m": ("sigma_m", "sigma", "accuracy", "accuracy_m"),
}
WANTED = (
    "wanted: a table with a heading (columns name; frame, px, py, or island, x, y; coordinate, or latitude, longitude; sigma_m), "
    "or a gcp_list.txt of OpenDroneMap"
)
_EPSG = re.compile(r"EPSG:(\d{4,5})", re.ASCII | re.IGNORECASE)
_UTM_WORDS = re.compile(r"WGS84 UTM (\d{1,2})\s*([NS])", re.ASCII | re.IGNORECASE)
_PROJ = re.compile(r"\+proj=utm .*?\+zone=(\d{1,2})", re.ASCII)
_OTHER = re.compile(
    r"\+(?:datum|ellps)=(?!WGS84\b|GRS80\b)\S+|\+units=(?!m\b)\S+|\+towgs84=(?!0(?:,0)*(?:\s|$))\S+", re.ASCII
)
EASTINGS_M, NORTHINGS_M = (0.0, 1e6), (-10e6, 10e6)  # of UTM; some count negative northings south of the equator


@dataclass(frozen=True, slots=True, kw_only=True)
class ControlPoint:
    """A coordinate (degrees; one standard deviation in metres), and the pixel of a frame, or the place of an island's canvas,
    that it is of. `written`: where it stands in the file."""

    label: str
    longitude_deg: float
    latitude_deg: float
    sigma_m: float
    written: str
    frame: str | None = None
    pixel: tuple[float, float] = (0.0, 0.0)
    island: int = 0
    canvas: tuple[float, float] = (0.0, 0.0)


def read_control_points(path: Path) -> list[ControlPoint]:
    """The points of a file, at least one. Raises UsageError, which tells the line."""
    try:
        text = inside.read_given(path, LARGEST_BYTES).decode("utf-8-sig")
    except OSError as error:
        if error.errno == errno.EFBIG:
            text = f"{path} has more than {LARGEST_BYTES >> 20} MB, which no list of control points has"
            raise UsageError(f"{text}; {WANTED}.") from None
        raise UsageError(f"{path} cannot be read ({error.strerror}): name a file of control points.") from error
    except UnicodeDecodeError as error:
        raise UsageError(f"{path} is no text; {WANTED}.") from error
    lines = [(number, line) for number, line in enumerate(text.splitlines(), 1) if line.strip() and line[0] != "#"]
    if not lines:
        raise UsageError(f"{path} is empty; {WANTED}.")
    projected = _projection(lines[0][1])
    points = _of_table(path, lines) if projected is None else _of_gcp_list(path, lines[1:], projected)
    if not points:
        raise UsageError(f"{path} has a heading and no points; {WANTED}.")
    if len(points) > MOST_PINS:
        raise UsageError(f"{path} has {len(points)} points, and {MOST_PINS} are taken at most.")
    return points


Project = Callable[[float, float], tuple[float, float]]  # to longitude and latitude in degrees


def _projection(line: str) -> Project | None:
    """What the first line of a gcp_list.txt names; None where it is none."""
    told = line.strip()
    if (found := _EPSG.fullmatch(told)) is not None:
        return _of_epsg(int(found[1]), told)
    if (found := _UTM_WORDS.fullmatch(told)) is not None:
        return _utm_zone(int(found[1]), is_north=found[2].upper() == "N")
    if told.startswith("+proj=") and (other := _OTHER.search(told)) is not None:
        raise UsageError(
            f"{other[0]} is not understood: give coordinates of WGS 84, in degrees or in a UTM zone in metres."
        )
    if (found := _PROJ.match(told)) is not None:
        return _utm_zone(int(found[1]), is_north="+south" not in told)
    if told.startswith("+proj=longlat"):
        return _degrees
    return None


def _of_epsg(code: int, told: str) -> Project:
    if code == 4326:
        return _degrees
    if 32601 <= code <= 32660 or 32701 <= code <= 32760:
        return _utm_zone(code % 100, is_north=code < 32700)
    raise UsageError(
        f"{told} is not understood: give coordinates as EPSG:4326 (longitude, latitude) or in a UTM zone (EPSG:326.., 327..)."
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


def _of_gcp_list(path: Path, lines: Sequence[tuple[int, str]], project: Project) -> list[ControlPoint]:
    """Lines of: geo_x geo_y geo_z im_x im_y image_name [gcp_name]."""
    points = []
    for number, line in lines:
        words = line.split()
        try:
            if len(words) < 6:
                raise Unfit("six words are wanted: geo_x geo_y geo_z im_x im_y image_name.")
            longitude, latitude = project(float(words[0]), float(words[1]))
            row = {"frame": words[5], "px": words[3], "py": words[4], "name": words[6] if len(words) > 6 else ""}
            points.append(_point(row | {"longitude": repr(longitude), "latitude": repr(latitude)}, number))
        except ValueError as error:
            raise UsageError(f"{path}, line {number}: {error}") from error
    return points


def _of_table(path: Path, lines: Sequence[tuple[int, str]]) -> list[ControlPoint]:
    heading = lines[0][1]
    separator = max(",;\t", key=heading.count)
    try:
        names = [_column(name) for name in next(csv.reader([heading], delimiter=separator))]
    except csv.Error as error:
        raise UsageError(f"{path}, line {lines[0][0]}: {error}; {WANTED}.") from error
    if not ({"coordinate"} <= set(names) or {"latitude", "longitude"} <= set(names)):
        raise UsageError(f'{path}: its heading "{heading.strip()[:80]}" names no coordinates; {WANTED}.')
    points = []
    for number, line in lines[1:]:
        try:
            cells = next(csv.reader(io.StringIO(line), delimiter=separator))
            row = {name: cell.strip() for name, cell in zip(names, cells, strict=False) if name is not None}
            points.append(_point(row, number))
        except (ValueError, UsageError, csv.Error) as error:
            raise UsageError(f"{path}, line {number}: {error}") from error
    return points


def _column(told: str) -> str | None:
    name = told.strip().lower()
    return next((ours for ours, names in COLUMNS.items() if name in names), None)


def _point(row: Mapping[str, str], number: int) -> ControlPoint:
    """Raises ValueError (Unfit) and UsageError."""
    if row.get("coordinate"):
        at = read_coordinate(row["coordinate"])
        longitude, latitude, least_m = at.longitude_deg, at.latitude_deg, at.least_sigma_m
    else:
        least_m = 0.0
        longitude = _number(row, "longitude", -180, 180)
        latitude = _number(row, "latitude", -90, 90)
    said_m = _number(row, "sigma_m", *SIGMAS_M) if row.get("sigma_m") else USUAL_SIGMA_M
    sigma = max(said_m, least_m)
    label = text_of(row.get("name", ""), "name", LONGEST_LABEL)
    bare = ControlPoint(
        label=label, longitude_deg=longitude, latitude_deg=latitude, sigma_m=sigma, written=f"line {number}"
    )
    if row.get("frame"):
        return replace(bare, frame=row["frame"], pixel=(_number(row, "px", 0, MOST_PX), _number(row, "py", 0, MOST_PX)))
    if not row.get("x"):
        raise Unfit("neither a frame with its pixel (frame, px, py) nor a place of the map (island, x, y) is named.")
    island = int(_number(row, "island", 0, 999_999)) if row.get("island") else 0
    canvas = _number(row, "x", -FURTHEST, FURTHEST), _number(row, "y", -FURTHEST, FURTHEST)
    return replace(bare, island=island, canvas=canvas)


def _number(row: Mapping[str, str], name: str, least: float, most: float) -> float:
    told = row.get(name, "")
    try:
        value = float(told)
    except ValueError:
        raise Unfit(f'{name} is to be a number from {least:g} to {most:g}, not "{told[:40]}".') from None
    return number_of(value, name, least, most)
