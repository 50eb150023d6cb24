"""`gcs-mosaic export --format tiff`: the map with every band of the frames at its depth.

Tiles are 8-bit images for display; the bands are painted again from the originals, with the same poses and shares, so that
their seams are those of the tiles.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gcs_mosaic.errors import UsageError
from gcs_mosaic.export.export import MOST_PIXELS, chosen_island
from gcs_mosaic.export.raster_file import Region, write_raster
from gcs_mosaic.export.rebuild import RebuildSource, RebuiltTiles, rebuilt, source_of
from gcs_mosaic.export.whole_file import whole_file
from gcs_mosaic.frames.temperature import CountUnit
from gcs_mosaic.render.tile_grid import TILE_SIZE, Box, level_from_canvas, pixel_size, tile_box, tile_range
from gcs_mosaic.store.folder import find_flight
from gcs_mosaic.views.flight_view import FlightView
from gcs_mosaic.views.thermal_scale import common_unit
from gcs_mosaic.views.tile_reader import level_within


def export_tiff(
    flight: Path, target: Path, *, island: int | None = None, level: int | None = None, gains: bool = True
) -> str:
    """Write an island (by default the largest) with all bands; returns a message.

    `gains`: with gain compensation between frames, as on the map; else the raw counts.
    """
    folder = find_flight(flight)
    source = source_of(folder, chosen_island(folder, island)["id"])
    bands, kind = bands_of(source)
    unit, no_degrees = unit_of(FlightView(folder), [source.frames[0].island], gains=gains)
    with (
        whole_file(target) as beside,
        rebuilt(source, "gained" if gains else "raw", target.resolve().parent) as tiles,
    ):
        extent = tiles.extent
        zoom = level_within(extent.box, MOST_PIXELS, extent.finest) if level is None else level
        region = region_of(extent.box, zoom)
        write_raster(beside, tiles, region, bands, kind, _about(tiles, region, gains), unit)
    finer = f"; --zoom {extent.finest} is the finest" if zoom < extent.finest else ""
    return (
        f"island {tiles.island} at level {zoom}, {region.width} x {region.height} pixels, {bands} "
        f"{'band' if bands == 1 else 'bands'} of {8 * kind.itemsize} bits and transparency, "
        f"{unit_words(unit)}{'with gains' if gains else 'without gains'}, written to {target}{finer}{left_out(source)}"
        f"{no_degrees}"
    )


def region_of(box: Box, level: int) -> Region:
    """The tiles of a level that contain a canvas box, cropped at its right and lower edge. UsageError if they are too many."""
    first, last = tile_range(box, level)
    right, bottom = np.ceil(level_from_canvas(level, np.array(box[2:]))).astype(int).tolist()
    width, height = right - first.x * TILE_SIZE, bottom - first.y * TILE_SIZE
    if width * height > MOST_PIXELS:
        raise UsageError(f"A picture of level {level} would have {width} x {height} pixels; give a lower --zoom.")
    return Region(first, last, width, height)


def bands_of(source: RebuildSource) -> tuple[int, np.dtype[Any]]:
    """Number of bands of the frames, and their type."""
    image = source.load(source.frames[0].name)
    if image is None:
        raise UsageError(f"the original of {source.frames[0].name} cannot be read any more.")
    return image.shape[2], image.dtype


def unit_of(view: FlightView, islands: Sequence[int], *, gains: bool) -> tuple[CountUnit | None, str]:
    """What a file of these islands' counts may call them, and the end of a message if gains have taken their unit: they multiply
    a frame's counts, and degrees do not follow. Raises UsageError."""
    unit = common_unit(view, islands)
    if unit is None or not gains:
        return unit, ""
    return None, "; with gains counts are no degrees: --no-gains writes those that the camera tells"


def unit_words(unit: CountUnit | None) -> str:
    """What counts are, within a message."""
    return "" if unit is None else f"degrees Celsius = {unit.per_count:g} x count {unit.at_zero:+g}, "


def _about(tiles: RebuiltTiles, region: Region, gains: bool) -> dict[str, Any]:
    """Metadata of the file: its georeference on the canvas (pixel edges, not centres), and the processing of counts."""
    left, top, _, _ = tile_box(region.first)
    size = pixel_size(region.first.z)
    return {
        "software": "gcs-mosaic",
        "island": tiles.island,
        "level": region.first.z,
        "canvas_from_pixel_edges": [[size, 0.0, left], [0.0, size, top]],
        "gains_applied": gains,
    }


def left_out(source: RebuildSource) -> str:
    reasons = {"of another kind": source.of_another_kind, "whose originals are gone": source.gone}
    told = [f"{count} frames {reason}" for reason, count in reasons.items() if count]
    return f"; left out: {', '.join(told)}" if told else ""
