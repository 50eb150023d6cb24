"""Files of control points: pixels of original frames, or places of the map, whose coordinates somebody has measured.

Two forms are read: a table with a heading (CSV, with commas, semicolons or tabs), and OpenDroneMap's `gcp_list.txt`.
"""

from __future__ import annotations

import csv
import errno
import io
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from gcs_mosaic.errors import UsageError
from gcs_mosaic.geo.coordinates import read_coordinate
from gcs_mosaic.geo.pins import USUAL_SIGMA_M
from gcs_mosaic.notes.anchors.pins import MOST_PINS
from gcs_mosaic.notes.anchors.projections import Project, projection_of
from gcs_mosaic.notes.storage.checked import FURTHEST, LONGEST_LABEL, Unfit, number_of, text_of
from gcs_mosaic.store import inside

LARGEST_BYTES = 1 << 20
MOST_TOLD = 20  # lines that cannot be used
SIGMAS_M = (0.01, 1000.0)
MOST_PX = float(1 << 20)
# Names of columns, the first of each being ours; without "#", and blanks and dashes as "_".
COLUMNS = {
    "name": ("name", "label", "gcp", "gcp_name", "gcp_label", "point", "point_id", "marker", "id"),
    "frame": ("frame", "image", "image_name", "imagename", "file", "file_name", "filename", "photo", "camera"),
    "px": ("px", "im_x", "image_x", "pixel_x", "x_px", "x_pixel", "u", "column"),
    "py": ("py", "im_y", "image_y", "pixel_y", "y_px", "y_pixel", "v", "row"),
    "island": ("island",),
    "x": ("x", "canvas_x"),
    "y": ("y", "canvas_y"),
    "coordinate": ("coordinate",),
    "latitude": ("latitude", "lat", "y/latitude", "latitude_deg"),
    "longitude": ("longitude", "lon", "lng", "long", "x/longitude", "longitude_deg"),
    "sigma_m": (
        "sigma_m",
        "sigma",
        "accuracy",
        "accuracy_m",
        "accuracy_(m)",
        "horizontal_accuracy",
        "accuracy_x/y_(m)",
    ),
    # In what the first line of the file names.
    "east": ("geo_x", "easting", "east", "x/easting"),
    "north": ("geo_y", "northing", "north", "y/northing"),
}
WANTED = (
    "wanted: a table with a heading (columns name; frame, px, py, or island, x, y; coordinate, or latitude, longitude; sigma_m), "
    "or a gcp_list.txt of OpenDroneMap"
)
_PICTURE = re.compile(
    r"(.+?\.(?:jpe?g|tiff?|png|dng|arw|cr[23]|nef|raw|bmp|webp|heic))(?:\s+(\S.*))?", re.ASCII | re.IGNORECASE
)


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


def read_control_points(path: Path, problems: list[str] | None = None) -> list[ControlPoint]:
    """The points of a file, at least one. A line that cannot be used is a sentence among the `problems`, with its number; raises
    UsageError if none can be used."""
    lines = [(number, line) for number, line in enumerate(_text(path).splitlines(), 1) if line.strip()]
    data = [(number, line) for number, line in lines if not _is_comment(line)]
    if not data:
        raise UsageError(f"{path} is empty; {WANTED}.")
    project = projection_of(data[0][1])
    rows = _rows(path, lines if project is None else data, project)
    points, found = [], list[str]()
    for number, row in rows:
        try:
            points.append(_point(row(), number))
        except (ValueError, UsageError, csv.Error) as error:
            found.append(f"{path}, line {number}: {error}")
    if not points:
        raise UsageError(found[0] if found else f"{path} has a heading and no points; {WANTED}.")
    if len(points) > MOST_PINS:
        raise UsageError(f"{path} has {len(points)} points, and {MOST_PINS} are taken at most.")
    if problems is not None:
        problems += found[:MOST_TOLD]
        problems += [f"{path}: {len(found) - MOST_TOLD} more lines cannot be used"] if len(found) > MOST_TOLD else []
    return points


# The cells of each line by their column, read when asked for: what raises is of that line alone.
Rows = Iterator[tuple[int, Callable[[], Mapping[str, str]]]]


def _text(path: Path) -> str:
    try:
        data = inside.read_given(path, LARGEST_BYTES)
    except OSError as error:
        if error.errno == errno.EFBIG:
            text = f"{path} has more than {LARGEST_BYTES >> 20} MB, which no list of control points has"
            raise UsageError(f"{text}; {WANTED}.") from None
        raise UsageError(f"{path} cannot be read ({error.strerror}): name a file of control points.") from error
    is_wide = data[:2] in (b"\xff\xfe", b"\xfe\xff")  # as spreadsheets save "Unicode text"
    # Names with umlauts, of a program that does not know UTF-8; a picture is no such text.
    is_western = not is_wide and sum(byte < 128 for byte in data) > 0.8 * len(data) and b"\0" not in data
    for encoding in ("utf-16",) if is_wide else ("utf-8-sig", *(("cp1252",) * is_western)):
        try:
            return data.decode(encoding)
        except UnicodeDecodeError:
            continue
    raise UsageError(f"{path} is no text; {WANTED}.")


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith("#")


def _rows(path: Path, lines: Sequence[tuple[int, str]], project: Project | None) -> Rows:
    """Raises UsageError where the first line says nothing of what follows."""
    if project is None:
        heading = next((at for at, (_, line) in enumerate(lines) if _names_columns(line)), None)
        first = next(at for at, (_, line) in enumerate(lines) if not _is_comment(line))
        return _of_table(path, lines[first if heading is None else heading :], None)
    if len(lines) > 1 and _names_columns(lines[1][1]):
        return _of_table(path, lines[1:], project)
    return ((number, partial(_of_gcp_line, line, project)) for number, line in lines[1:])


def _of_gcp_line(line: str, project: Project) -> Mapping[str, str]:
    """A line of: geo_x geo_y geo_z im_x im_y image_name [gcp_name]. Raises ValueError."""
    words = _words(line)
    if len(words) < 6:
        raise Unfit("six words are wanted: geo_x geo_y geo_z im_x im_y image_name.")
    names = ("east", "north", "geo_z", "px", "py", "frame", "name")
    return _projected(dict(zip(names, (*words, ""), strict=False)), project)


def _words(line: str) -> list[str]:
    """Between tabs, or else commas or semicolons, or else blanks: names of files have blanks, too."""
    for separator in "\t;,":
        cells = next(csv.reader([line], delimiter=separator), [])
        words = [cell.strip() for cell in cells if cell.strip()]
        if len(words) >= 6:
            return words
    words = line.split(None, 5)
    if len(words) < 6:
        return words
    if (found := _PICTURE.fullmatch(words[5].strip())) is not None:
        return [*words[:5], found[1], *(found[2] or "").split()[:1]]
    return [*words[:5], *words[5].split()]


def _projected(row: dict[str, str], project: Project) -> dict[str, str]:
    longitude, latitude = project(_decimal(row.get("east", "")), _decimal(row.get("north", "")))
    return row | {"longitude": repr(longitude), "latitude": repr(latitude)}


def _names_columns(line: str) -> bool:
    """Whether a line is the heading of a table, also one that begins with "#"."""
    names = {_column(cell) for cell in re.split(r"[,;\t]", line)} - {None}
    return len(names) > 2 and bool(names & {"coordinate", "latitude", "east"})


def _of_table(path: Path, lines: Sequence[tuple[int, str]], project: Project | None) -> Rows:
    heading = lines[0][1]
    separator = max(",;\t", key=heading.count)
    try:
        names = [_column(name) for name in next(csv.reader([heading], delimiter=separator))]
    except csv.Error as error:
        raise UsageError(f"{path}, line {lines[0][0]}: {error}; {WANTED}.") from error
    there = set(names)
    if project is None and not ({"coordinate"} <= there or {"latitude", "longitude"} <= there):
        raise UsageError(f'{path}: its heading "{heading.strip()[:80]}" names no coordinates; {WANTED}.')

    def cells(line: str) -> Mapping[str, str]:
        told = next(csv.reader(io.StringIO(line), delimiter=separator))
        row = {name: cell.strip() for name, cell in zip(names, told, strict=False) if name is not None}
        return row if project is None else _projected(row, project)

    return ((number, partial(cells, line)) for number, line in lines[1:] if not _is_comment(line))


def _column(told: str) -> str | None:
    name = re.sub(r"[\s-]+", "_", told.strip().strip("#\"'").strip().lower())
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
        row = row if row.get("px") or row.get("py") else {**row, "px": row.get("x", ""), "py": row.get("y", "")}
        return replace(bare, frame=row["frame"], pixel=(_number(row, "px", 0, MOST_PX), _number(row, "py", 0, MOST_PX)))
    if not row.get("x"):
        raise Unfit("neither a frame with its pixel (frame, px, py) nor a place of the map (island, x, y) is named.")
    island = int(_number(row, "island", 0, 999_999)) if row.get("island") else 0
    canvas = _number(row, "x", -FURTHEST, FURTHEST), _number(row, "y", -FURTHEST, FURTHEST)
    return replace(bare, island=island, canvas=canvas)


def _number(row: Mapping[str, str], name: str, least: float, most: float) -> float:
    told = row.get(name, "")
    try:
        value = _decimal(told)
    except ValueError:
        raise Unfit(f'{name} is to be a number from {least:g} to {most:g}, not "{told[:40]}".') from None
    return number_of(value, name, least, most)


def _decimal(told: str) -> float:
    """Also with a decimal comma. Raises ValueError."""
    return float(told.replace(",", ".") if told.count(",") == 1 and "." not in told else told)
