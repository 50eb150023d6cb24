"""`gcs-mosaic export --format geotiff` and `cog`: the map on earth as one TIFF with coordinates, overviews and transparency.

Every pixel is made by the same warp as the tiles of other maps; an overview is made from the canvas' own coarser tiles. With
`--bands` the bands of the frames are painted again from the originals (`rebuild`) and warped at their full depth.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, TypeAlias
from xml.sax.saxutils import escape

import numpy as np
import tifffile

from gcs_mosaic.errors import UsageError
from gcs_mosaic.export.cog_layout import as_cog
from gcs_mosaic.export.earth_map import EarthMap, check_mercator, left_out_words
from gcs_mosaic.export.earth_tiles import Progress
from gcs_mosaic.export.export import MOST_PIXELS
from gcs_mosaic.export.raster_file import BIG, GDAL_METADATA, GDAL_NODATA, UNASSOCIATED_ALPHA, unit_items
from gcs_mosaic.export.whole_file import whole_file
from gcs_mosaic.frames.temperature import CountUnit
from gcs_mosaic.geo.mercator import HALF_WORLD_M, mercator, resolution_m
from gcs_mosaic.geo.transverse_mercator import LATITUDES_DEG, zone_of
from gcs_mosaic.geotiles.earth_islands import Bounds, bounds_of
from gcs_mosaic.geotiles.picture_grid import PictureGrid, UtmZone
from gcs_mosaic.stitch.arrays import AnyImage

Crs: TypeAlias = Literal["EPSG:3857", "utm"]
# Makes a picture (h, w, bands and coverage) of the whole type; None where nothing was seen.
Draw: TypeAlias = Callable[[PictureGrid], AnyImage | None]

SIDE = 512  # px of the file's tiles
PIXEL_SCALE, TIE_POINT, GEO_KEYS = 33550, 33922, 34735
# GeoTIFF keys: model type projected, pixels are areas, the projected system by its EPSG code, metres.
MODEL_TYPE, RASTER_TYPE, PROJECTED, LINEAR_UNITS = 1024, 1025, 3072, 3076
MERCATOR_EPSG, METRE = 3857, 9001


@dataclass(frozen=True, slots=True)
class Bandwise:
    """What is written of each pixel: so many bands of a type, and their coverage."""

    draw: Draw
    bands: int
    kind: np.dtype[Any]
    told: str = ""  # of frames that were left out, and of units
    unit: CountUnit | None = None  # of the first band


def export_raster(
    found: EarthMap, target: Path, crs: Crs, level: int | None, pixels: Bandwise, progress: Progress, *, cog: bool
) -> str:
    """Write it; returns a message. `level`: the one of Web Mercator whose pixels are as large. Raises UsageError."""
    grid = grid_of(found, crs, level)
    grids = [grid, *_overviews(grid)]
    with whole_file(target) as path:
        plain = path.with_name(f"{path.name}.tif") if cog else path
        try:
            _write(plain, found, grids, pixels, progress)
            if cog:
                as_cog(plain, path)
        finally:
            if cog:
                plain.unlink(missing_ok=True)
    size = f"{grid.width} x {grid.height} pixels of {grid.steps[0]:.3g} m ({_epsg(grid)})"
    bands = (
        f"{pixels.bands} {'band' if pixels.bands == 1 else 'bands'} of {8 * pixels.kind.itemsize} bits and transparency"
    )
    return f"{size}, {bands}, {found.about()['error']}, written to {target}{left_out_words(found)}{pixels.told}"


def of_tiles(found: EarthMap) -> Bandwise:
    """Red, green and blue as on the page."""

    def draw(grid: PictureGrid) -> AnyImage | None:
        picture = found.pyramid.picture(grid)
        return None if picture is None else np.ascontiguousarray(picture[..., [2, 1, 0, 3]])

    return Bandwise(draw, 3, np.dtype(np.uint8))


def grid_of(found: EarthMap, crs: Crs, level: int | None = None) -> PictureGrid:
    """The picture's pixels. Those of Web Mercator lie on the pixels of its tiles. Raises UsageError."""
    last = found.finest_level(level)
    while True:
        grid = _mercator_grid(found, last) if crs == "EPSG:3857" else _utm_grid(found, last)
        if grid.width * grid.height <= MOST_PIXELS:
            return grid
        if level is not None:
            raise UsageError(
                f"--zoom {level} has {grid.width} x {grid.height} pixels, which is too many: give a lower one."
            )
        last -= 1


def _mercator_grid(found: EarthMap, level: int) -> PictureGrid:
    check_mercator(found)
    west, south, east, north = _within(found, found.pyramid.mercator_bounds, mercator)
    if east - west >= HALF_WORLD_M:
        raise UsageError("The map lies across the 180th meridian: export each island by --crs utm.")
    step = resolution_m(level)
    left, right = math.floor((west + HALF_WORLD_M) / step), math.ceil((east + HALF_WORLD_M) / step)
    top, bottom = math.floor((HALF_WORLD_M - north) / step), math.ceil((HALF_WORLD_M - south) / step)
    bounds = (
        left * step - HALF_WORLD_M,
        HALF_WORLD_M - bottom * step,
        right * step - HALF_WORLD_M,
        HALF_WORLD_M - top * step,
    )
    return PictureGrid("mercator", bounds, right - left, bottom - top)


def _utm_grid(found: EarthMap, level: int) -> PictureGrid:
    """Pixels as large as those of the level on the ground; corners at whole pixels."""
    longitude, latitude = found.middle
    if not LATITUDES_DEG[0] <= latitude <= LATITUDES_DEG[1]:
        raise UsageError("UTM has no zones near the poles: leave --crs out, or give --format kmz.")
    zone = UtmZone(zone_of(longitude, latitude), is_north=latitude >= 0)
    outlines = np.concatenate([zone.points(one.outline) for one in found.pyramid.islands])
    low_x, low_y, high_x, high_y = _within(found, bounds_of(outlines), zone.points)
    step = float(f"{resolution_m(level) * math.cos(math.radians(latitude)):.2g}")
    left, bottom = math.floor(low_x / step), math.floor(low_y / step)
    right, top = math.ceil(high_x / step), math.ceil(high_y / step)
    bounds = left * step, bottom * step, right * step, top * step
    return PictureGrid("utm", bounds, right - left, top - bottom, zone)


def _within(found: EarthMap, whole: Bounds | None, points_of: Callable[[Any], Any]) -> Bounds:
    """Bounds in a plane's units, within the box that is asked for."""
    assert whole is not None, "a map without an island is not exported"
    if found.box is None:
        return whole
    west, south, east, north = found.bounds
    cut = bounds_of(points_of(np.array([[west, south], [east, south], [east, north], [west, north]])))
    return max(whole[0], cut[0]), max(whole[1], cut[1]), min(whole[2], cut[2]), min(whole[3], cut[3])


def _overviews(grid: PictureGrid) -> Iterator[PictureGrid]:
    """Each half as wide as the one before, until one fits into a tile; what is cut off by rounding is laid on."""
    while max(grid.width, grid.height) > SIDE:
        (across, down), (west, _, _, north) = grid.steps, grid.bounds
        width, height = -(-grid.width // 2), -(-grid.height // 2)
        bounds = west, north - 2 * height * down, west + 2 * width * across, north
        grid = replace(grid, bounds=bounds, width=width, height=height)
        yield grid


def _write(path: Path, found: EarthMap, grids: list[PictureGrid], pixels: Bandwise, progress: Progress) -> None:
    count = sum(-(-grid.width // SIDE) * -(-grid.height // SIDE) for grid in grids)
    done = 0

    def tiles(grid: PictureGrid) -> Iterator[AnyImage]:
        nonlocal done
        for window in _windows(grid):
            done += 1
            progress(done, count)
            yield _filled(pixels, window)

    large = sum(grid.width * grid.height for grid in grids) * (pixels.bands + 1) * pixels.kind.itemsize > BIG
    with tifffile.TiffWriter(path, bigtiff=large, byteorder="<") as file:
        for number, grid in enumerate(grids):
            first = number == 0
            file.write(
                tiles(grid),
                shape=(grid.height, grid.width, pixels.bands + 1),
                dtype=pixels.kind,
                tile=(SIDE, SIDE),
                photometric="rgb" if pixels.bands == 3 else "minisblack",
                planarconfig="contig",
                extrasamples=[0] * (pixels.bands - (3 if pixels.bands == 3 else 1)) + [UNASSOCIATED_ALPHA],
                compression="zlib",
                predictor=True,
                subfiletype=0 if first else 1,
                metadata=None,
                description=found.sentence().encode() if first else None,
                software=False,
                extratags=_tags(found, grid, pixels) if first else [],
            )


def _tags(found: EarthMap, grid: PictureGrid, pixels: Bandwise) -> list[tuple[Any, ...]]:
    west, _, _, north = grid.bounds
    across, down = grid.steps
    keys = [(MODEL_TYPE, 1), (RASTER_TYPE, 1), (PROJECTED, _epsg_number(grid)), (LINEAR_UNITS, METRE)]
    directory = [1, 1, 0, len(keys), *(value for key, number in keys for value in (key, 0, 1, number))]
    tags: list[tuple[Any, ...]] = [
        (PIXEL_SCALE, "d", 3, (across, down, 0.0), True),
        (TIE_POINT, "d", 6, (0.0, 0.0, 0.0, west, north, 0.0), True),
        (GEO_KEYS, "H", len(directory), tuple(directory), True),
        (GDAL_METADATA, "s", 0, _metadata(found, pixels.unit), True),
    ]
    # With other numbers of bands many programs ignore the alpha band, but they know this tag.
    return tags if pixels.bands in (1, 3) else [*tags, (GDAL_NODATA, "s", 0, "0", True)]


def _metadata(found: EarthMap, unit: CountUnit | None) -> str:
    about = found.about()
    items = {name: value if isinstance(value, str) else json.dumps(value) for name, value in about.items()}
    rows = "".join(f'<Item name="{name.upper()}">{escape(value)}</Item>' for name, value in items.items())
    rows += unit_items(unit)
    return f"<GDALMetadata>{rows}</GDALMetadata>".encode("ascii", "xmlcharrefreplace").decode()


def _windows(grid: PictureGrid) -> Iterator[PictureGrid]:
    """The file's tiles, row by row, those at the right and lower edge with what is beyond it."""
    (across, down), (west, _, _, north) = grid.steps, grid.bounds
    for top in range(0, grid.height, SIDE):
        for left in range(0, grid.width, SIDE):
            x, y = west + left * across, north - top * down
            yield replace(grid, bounds=(x, y - SIDE * down, x + SIDE * across, y), width=SIDE, height=SIDE)


def _filled(pixels: Bandwise, window: PictureGrid) -> AnyImage:
    drawn = pixels.draw(window)
    return np.zeros((SIDE, SIDE, pixels.bands + 1), pixels.kind) if drawn is None else drawn


def _epsg_number(grid: PictureGrid) -> int:
    return MERCATOR_EPSG if grid.zone is None else grid.zone.epsg


def _epsg(grid: PictureGrid) -> str:
    return f"EPSG:{_epsg_number(grid)}"
