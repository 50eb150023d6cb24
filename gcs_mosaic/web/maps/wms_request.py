"""What is asked in WMS's words (1.1.1 and 1.3.0): checked, or refused in the protocol's own way."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, TypeAlias

from gcs_mosaic.geotiles.picture_grid import PictureGrid
from gcs_mosaic.web.maps.addresses import WMS_LAYER
from gcs_mosaic.web.maps.pictures import MapLook, Suffix

Version: TypeAlias = Literal["1.1.1", "1.3.0"]
MOST_SIDE = 4096  # px
MOST_PIXELS = 1 << 23  # a screen of 3840 x 2160; it is made in some ten seconds of one core
TOLD_SIDE = 2048  # px a side, by which programs divide larger pictures
FURTHEST = 1e9  # of a box, in metres or degrees
LEAST_STEP = 1e-14  # of a pixel beside the box's own numbers: of less they have no digits left
FORMATS: dict[str, Suffix] = {"image/png": "png", "image/jpeg": "jpg", "image/jpg": "jpg", "image/webp": "webp"}
MERCATOR = ("EPSG:3857", "EPSG:900913", "EPSG:102100")  # today's name and two older ones
DEGREES = ("EPSG:4326", "CRS:84")
COLOUR = re.compile("0[xX]([0-9a-fA-F]{6})")
STYLES = ("", "default")


@dataclass(eq=False)  # not frozen: contextlib sets the traceback of what passes it
class WmsFault(Exception):  # noqa: N818 - its name in the protocol's world
    """`code`: of the standard, or none; `said`: a sentence."""

    version: Version
    code: str | None
    said: str


@dataclass(frozen=True, slots=True)
class MapRequest:
    """A picture that is asked for, checked."""

    version: Version
    grid: PictureGrid
    look: MapLook


def lower_names(query: Mapping[str, str]) -> dict[str, str]:
    """Names of parameters count without regard to their case."""
    return {name.lower(): value for name, value in query.items()}


def version_of(asked: Mapping[str, str]) -> Version:
    """Of the two that are spoken the nearest: by number or, without one, by how the reference system is named."""
    said = asked.get("version") or asked.get("wmtver") or ("1.1.1" if "srs" in asked else "1.3.0")
    return "1.1.1" if said < "1.3" else "1.3.0"


def map_request(asked: Mapping[str, str]) -> MapRequest:
    """A GetMap, of parameters by their names in lower case. Raises WmsFault."""
    version = version_of(asked)
    _check_layers(asked, version)
    suffix = FORMATS.get(asked.get("format", "image/png").partition(";")[0].strip().lower())
    if suffix is None:
        raise WmsFault(version, "InvalidFormat", f"FORMAT is to be one of {', '.join(FORMATS)}.")
    width, height = (_side(asked, name, version) for name in ("width", "height"))
    if width * height > MOST_PIXELS:
        raise WmsFault(version, None, f"A picture has at most {MOST_PIXELS} pixels: ask for it in parts.")
    grid = _grid(asked, version, width, height)
    is_transparent = asked.get("transparent", "").upper() == "TRUE" and suffix != "jpg"
    background = None if is_transparent else _background(asked, version)
    return MapRequest(version, grid, MapLook(suffix, None, asked.get("underlay") == "1", background))


def _check_layers(asked: Mapping[str, str], version: Version) -> None:
    """Programs that know of one layer only name none."""
    layers = [name.strip() for name in asked.get("layers", "").split(",") if name.strip()]
    if any(name != WMS_LAYER for name in layers):
        raise WmsFault(version, "LayerNotDefined", f"There is one layer: {WMS_LAYER}.")
    if any(style.strip() not in STYLES for style in asked.get("styles", "").split(",")):
        raise WmsFault(version, "StyleNotDefined", "There is one style, which has no name.")


def _side(asked: Mapping[str, str], name: str, version: Version) -> int:
    said = asked.get(name, "")
    value = int(said) if said.isascii() and said.isdigit() and len(said) <= 6 else 0
    if not 1 <= value <= MOST_SIDE:
        raise WmsFault(version, None, f"{name.upper()} is to be a whole number from 1 to {MOST_SIDE}.")
    return value


def _grid(asked: Mapping[str, str], version: Version, width: int, height: int) -> PictureGrid:
    name = asked.get("crs" if version == "1.3.0" else "srs", "").strip().upper()
    if name not in (*MERCATOR, *DEGREES):
        code = "InvalidCRS" if version == "1.3.0" else "InvalidSRS"
        raise WmsFault(version, code, f"The reference system is to be one of {', '.join((*MERCATOR[:1], *DEGREES))}.")
    try:
        first, second, third, fourth = map(float, asked.get("bbox", "").split(","))
    except ValueError:
        first = second = third = fourth = math.nan
    if version == "1.3.0" and name == "EPSG:4326":  # latitude comes first there, and only there
        first, second, third, fourth = second, first, fourth, third
    is_box = -FURTHEST <= first < third <= FURTHEST and -FURTHEST <= second < fourth <= FURTHEST
    least = LEAST_STEP * max(1.0, *map(abs, (first, second, third, fourth)))
    if not is_box or min((third - first) / width, (fourth - second) / height) < least:
        told = "BBOX is to be four numbers, left, bottom, right, top, each side longer than nothing"
        axes = "; of EPSG:4326 latitudes come first in WMS 1.3.0" if version == "1.3.0" else ""
        raise WmsFault(version, None, f"{told}{axes}.")
    plane: Literal["mercator", "degrees"] = "mercator" if name in MERCATOR else "degrees"
    return PictureGrid(plane, (first, second, third, fourth), width, height)


def _background(asked: Mapping[str, str], version: Version) -> tuple[int, int, int]:
    found = COLOUR.fullmatch(asked.get("bgcolor", "0xFFFFFF"))
    if found is None:
        raise WmsFault(version, None, "BGCOLOR is to be a colour such as 0xFFFFFF.")
    red, green, blue = bytes.fromhex(found[1])
    return red, green, blue
