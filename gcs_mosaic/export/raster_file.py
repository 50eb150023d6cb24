"""A map with all its bands as one TIFF: tiled, compressed, BigTIFF if needed, transparent where nothing was seen."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import tifffile

from gcs_mosaic.frames.temperature import CountUnit
from gcs_mosaic.render.tile_grid import TILE_SIZE, Tile
from gcs_mosaic.stitch.arrays import Bands
from gcs_mosaic.views.hole_filling import Tiles, filled_picture

BIG = 3_900_000_000  # bytes before compression beyond which 32-bit offsets might not suffice
GDAL_METADATA, GDAL_NODATA = 42112, 42113  # tags: an XML text; the nodata value, as text
UNASSOCIATED_ALPHA = 2  # of TIFF's ExtraSamples


class Region(NamedTuple):
    """Tiles from `first` to `last` (inclusive) of one level, cropped to this size at the right and bottom."""

    first: Tile
    last: Tile
    width: int
    height: int


def unit_items(unit: CountUnit | None) -> str:
    """What GDAL reads of the first band: counts times scale plus offset are degrees Celsius."""
    if unit is None:
        return ""
    said = {"unittype": "degC", "scale": f"{unit.per_count:.15g}", "offset": f"{unit.at_zero:.15g}"}
    said["description"] = "Temperature as the camera tells it"
    return "".join(
        f'<Item name="{role.upper()}" sample="0" role="{role}">{value}</Item>' for role, value in said.items()
    )


def write_raster(
    path: Path,
    tiles: Tiles,
    region: Region,
    bands: int,
    kind: np.dtype[Any],
    about: dict[str, Any],
    unit: CountUnit | None = None,
) -> None:
    """Write a region's bands, three as red, green and blue, others in their order, and the coverage as the last one.

    Only one tile is in memory at a time. `about`: metadata, as JSON; `unit` of the first band. OSError if it cannot be written.
    """
    size = region.width * region.height * (bands + 1) * kind.itemsize
    tifffile.imwrite(
        path,
        _tiles(tiles, region, bands, kind),
        shape=(region.height, region.width, bands + 1),
        dtype=kind,
        tile=(TILE_SIZE, TILE_SIZE),
        photometric="rgb" if bands == 3 else "minisblack",
        planarconfig="contig",
        extrasamples=[0] * (bands - (3 if bands == 3 else 1)) + [UNASSOCIATED_ALPHA],
        compression="zlib",
        predictor=True,
        bigtiff=size > BIG,
        # With other numbers of bands many programs ignore the alpha band, but they know this tag.
        extratags=[*_units(unit), *([] if bands in (1, 3) else [(GDAL_NODATA, "s", 0, "0", True)])],
        metadata=None,
        description=json.dumps(about),
    )


def _units(unit: CountUnit | None) -> list[tuple[int, str, int, str, bool]]:
    return [(GDAL_METADATA, "s", 0, f"<GDALMetadata>{unit_items(unit)}</GDALMetadata>", True)] if unit else []


def _tiles(tiles: Tiles, region: Region, bands: int, kind: np.dtype[Any]) -> Iterator[Bands]:
    """(256, 256, bands + 1) each, row by row."""
    opaque = np.iinfo(kind).max // 255
    nothing = np.zeros((TILE_SIZE, TILE_SIZE, bands + 1), kind)
    for y in range(region.first.y, region.last.y + 1):
        for x in range(region.first.x, region.last.x + 1):
            seen = filled_picture(tiles, Tile(region.first.z, x, y))
            if seen is None or seen.bands is None:
                yield nothing
            else:
                ordered = seen.bands[..., ::-1] if bands == 3 else seen.bands
                yield np.dstack([ordered, seen.coverage.astype(kind) * kind.type(opaque)])
