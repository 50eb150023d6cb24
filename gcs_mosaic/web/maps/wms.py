"""WMS 1.1.1 and 1.3.0, for Mission Planner and QGIS."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
from aiohttp import web

from gcs_mosaic.geo.mercator import FINEST_LEVEL
from gcs_mosaic.geotiles.picture_grid import PictureGrid, grid_of_tile
from gcs_mosaic.geotiles.pyramid import BLOCK
from gcs_mosaic.render.tile_grid import TILE_SIZE
from gcs_mosaic.stitch.arrays import ImageBGRA
from gcs_mosaic.web.api.operations import Media, Reply
from gcs_mosaic.web.maps.addresses import addresses_for
from gcs_mosaic.web.maps.common import MAP, PICTURES, LookQuery, MapOperations, document, map_now, tile_of
from gcs_mosaic.web.maps.pictures import encoded
from gcs_mosaic.web.maps.served_map import MapNow
from gcs_mosaic.web.maps.wms_capabilities import capabilities, fault_document
from gcs_mosaic.web.maps.wms_request import MapRequest, WmsFault, lower_names, map_request, version_of
from gcs_mosaic.web.tile_answer import tagged

LARGE_PX = 1 << 20  # of such pictures one is made at a time
MOST_WAITING = 4  # for a large picture, the one that is made included
LONGEST_S = 45.0  # of wall time for a picture, on a machine that has other things to do
SAME_PX = 1e-3  # a box so near that of a tile is the tile's


@dataclass(slots=True)
class LargePictures:
    """One is made at a time, and few wait."""

    waiting: int = 0
    _one: asyncio.Lock = field(default_factory=asyncio.Lock)

    @asynccontextmanager
    async def turn(self, asked: MapRequest) -> AsyncIterator[None]:
        """Raises WmsFault when as many wait already. A small picture waits for nobody."""
        if asked.grid.width * asked.grid.height <= LARGE_PX:
            yield
            return
        if self.waiting >= MOST_WAITING:
            raise WmsFault(
                asked.version, None, "Several large pictures are being made: ask again, or for a smaller one."
            )
        self.waiting += 1
        try:
            async with self._one:
                yield
        finally:
            self.waiting -= 1


LARGE = web.AppKey("large_pictures", LargePictures)
ANSWERS = Media((*PICTURES.types, "text/xml", "application/vnd.ogc.wms_xml", "application/vnd.ogc.se_xml"))
OPERATIONS = MapOperations()


@dataclass(frozen=True, slots=True, kw_only=True)
class WmsQuery(LookQuery):
    """As the standard has it."""

    REQUEST: Annotated[
        str | None,
        "GetCapabilities or GetMap; the others as the standard has them. "
        "EPSG:3857, EPSG:4326, CRS:84; at most 4096 px a side and 8,388,608 in all.",
    ] = None


def keep_turns(app: web.Application) -> None:
    """For requests to come."""
    app[LARGE] = LargePictures()


@OPERATIONS.of_map(
    "wms", Reply("Capabilities, a picture, or a ServiceExceptionReport.", ANSWERS, tagged=True), query=WmsQuery
)
async def wms(request: web.Request) -> web.StreamResponse:
    """WMS 1.1.1 and 1.3.0: GetCapabilities and GetMap; names of parameters in any case.

    What cannot be answered is refused as the protocol does, in an answer that is a success.
    """
    now = await map_now(request)
    asked = lower_names(request.query)
    version = version_of(asked)
    wanted = asked.get("request", "").lower()
    try:
        if wanted in ("getcapabilities", "capabilities"):
            text, kind = capabilities(now, addresses_for(request, now.flight), version)
            return document(request, text, kind)
        if wanted not in ("getmap", "map"):
            said = "GetCapabilities and GetMap are what can be asked for."
            raise WmsFault(version, "OperationNotSupported", said)
        return await picture(request, now, map_request(asked))
    except WmsFault as fault:
        text, kind = fault_document(fault)
        return document(request, text, kind)


async def picture(request: web.Request, now: MapNow, asked: MapRequest) -> web.Response:
    """A tile if the box is one, else a picture made for this question."""
    tile = tile_in(asked.grid)
    if tile is not None:
        return await tile_of(request, *tile, asked.look)
    async with request.app[LARGE].turn(asked):
        made = await drawn(request, now, asked)
        encoded_picture = await request.app[MAP].work(encoded, made, asked.look)
    return tagged(request, encoded_picture.data, encoded_picture.media_type)


async def drawn(request: web.Request, now: MapNow, asked: MapRequest) -> ImageBGRA:
    """A picture strip by strip, so that tiles are answered meanwhile, and that it ends when nobody waits for it any more.

    Raises WmsFault if it takes too long.
    """
    grid, end = asked.grid, time.monotonic() + LONGEST_S
    whole = np.zeros((grid.height, grid.width, 4), np.uint8)
    for top in range(0, grid.height, BLOCK):
        if time.monotonic() > end:
            raise WmsFault(asked.version, None, f"This picture takes more than {LONGEST_S:g} s: ask for a smaller one.")
        strip = strip_of(grid, top, min(top + BLOCK, grid.height))
        part = await request.app[MAP].work(now.pyramid.picture, strip)
        if part is not None:
            whole[top : top + strip.height] = part
    return whole


def strip_of(grid: PictureGrid, top: int, bottom: int) -> PictureGrid:
    """Rows of a picture."""
    west, _, east, north = grid.bounds
    down = grid.steps[1]
    return PictureGrid(grid.plane, (west, north - bottom * down, east, north - top * down), grid.width, bottom - top)


def tile_in(grid: PictureGrid) -> tuple[int, int, int] | None:
    """The XYZ tile whose box this is; None if it is none.

    Mission Planner asks for tiles of Mercator by their corners in degrees, and shows what comes as such a tile.
    """
    if (grid.width, grid.height) != (TILE_SIZE, TILE_SIZE):
        return None
    west, south, east, north = grid.bounds
    count = grid.once_round / (east - west)
    level = round(math.log2(count)) if 0.5 < count < 1 << (FINEST_LEVEL + 1) else -1
    if not 0 <= level <= FINEST_LEVEL:
        return None
    left, _, _, top = (corner / grid.once_round for corner in (west, south, east, north))
    x = round((left + 0.5) * 2**level)
    y = round(rows_from_north(grid, top) * 2**level)
    if not (0 <= x < 1 << level and 0 <= y < 1 << level):
        return None
    corners = corners_in_plane(grid, level, x, y)
    off = max(abs(one - other) for one, other in zip(corners, grid.bounds, strict=True))
    return (level, x, y) if off < SAME_PX * (east - west) / TILE_SIZE else None


def rows_from_north(grid: PictureGrid, top: float) -> float:
    """Of the square world's height, how much lies above a northern border, given as a part of the earth's girth."""
    if grid.plane == "mercator":
        return 0.5 - top
    latitude = math.radians(max(min(top * 360, 89.9), -89.9))
    return 0.5 - math.asinh(math.tan(latitude)) / (2 * math.pi)


def corners_in_plane(grid: PictureGrid, level: int, x: int, y: int) -> tuple[float, float, float, float]:
    """A tile's bounds in the units of a picture."""
    tile = grid_of_tile(level, x, y)
    if grid.plane == "mercator":
        return tile.bounds
    ends = np.array([0.0, TILE_SIZE])
    (west, north), (east, south) = tile.places(ends, ends)[[0, 1], [0, 1]].tolist()
    return west, south, east + 360 if east <= west else east, north
