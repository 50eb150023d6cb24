"""For Google Earth: a network link to a super-overlay (KML 2.2), whose parts are the XYZ tiles.

Of a tree of regions Google Earth loads what is in view, at the fineness at which it is seen, and keeps the rest; one picture of
the view, refreshed, would be loaded anew with each move. A tile's picture is asked for again every few seconds while it is in
view. The tree is not: it reaches far beyond the map, which grows, and a link that is loaded again takes away what it has shown.
"""

from __future__ import annotations

from xml.sax.saxutils import escape

import numpy as np
from aiohttp import web

from gcs_mosaic.geo.mercator import HALF_WORLD_M, TILE_SIZE
from gcs_mosaic.geotiles.earth_islands import Bounds
from gcs_mosaic.geotiles.picture_grid import grid_of_tile
from gcs_mosaic.web.api.operations import Media, Reply
from gcs_mosaic.web.maps.addresses import MapAddresses, addresses_for
from gcs_mosaic.web.maps.common import (
    TILE,
    MapOperations,
    about,
    document,
    map_now,
)
from gcs_mosaic.web.maps.served_map import MapNow

MEDIA = "application/vnd.google-earth.kml+xml"
PICTURE_S = 10  # until it is asked for again
BEGINS = 3  # levels below the one at which the map is a dot
SHOWN_FROM_PX, SHOWN_TO_PX = 128, 2048  # on the screen: of a tile of 256 px
DEGREE_M = HALF_WORLD_M / 180  # along the equator
HEAD = '<?xml version="1.0" encoding="UTF-8"?>\n<kml xmlns="http://www.opengis.net/kml/2.2"><Document>'
TAIL = "</Document></kml>\n"


OPERATIONS = MapOperations()


@OPERATIONS.of_map("map.kml", Reply("The document.", Media((MEDIA,)), tagged=True))
async def start(request: web.Request) -> web.StreamResponse:
    """A network link for Google Earth (KML 2.2), to the coarsest tiles."""
    now = await map_now(request)
    return document(request, as_start(now, addresses_for(request, now.flight)), MEDIA, "gcs-mosaic.kml")


@OPERATIONS.of_map(f"kml/{TILE}.kml", Reply("The document.", Media((MEDIA,)), tagged=True))
async def part(request: web.Request) -> web.StreamResponse:
    """A part of the tree that the network link leads to: a tile on the ground, and links to those of the next level."""
    now = await map_now(request)
    level, x, y = (int(request.match_info[name]) for name in ("z", "x", "y"))
    levels = now.pyramid.levels
    if levels is None or not levels[0] <= level <= levels[1] or max(x, y) >= 1 << level:
        return document(request, HEAD + TAIL, MEDIA)
    addresses, finest = addresses_for(request, now.flight), levels[1]
    children = [(2 * x + i, 2 * y + j) for i in range(2) for j in range(2)] if level < finest else []
    finer = "".join(_link(addresses, level + 1, *child, SHOWN_FROM_PX) for child in children)
    return document(request, f"{HEAD}{_overlay(addresses, level, x, y, finest)}{finer}{TAIL}", MEDIA)


def as_start(now: MapNow, addresses: MapAddresses) -> str:
    """The KML that is opened."""
    links = "".join(_link(addresses, *tile, 0) for tile in _first_tiles(now))
    name = f"<name>gcs-mosaic: {escape(now.title)}</name><description>{escape(about(now))}</description>"
    return f"{HEAD}{name}{_look_at(now)}{links}{TAIL}"


def _first_tiles(now: MapNow) -> list[tuple[int, int, int]]:
    """The tiles that the tree begins with: those about each island of a level at which the largest is some ten pixels.

    What lies between islands is left out: a single pin with a wrong sign lays one on the other side of the earth.
    """
    if now.pyramid.levels is None:
        return []
    level = now.pyramid.levels[0] + BEGINS
    count = 1 << level
    near = {(x + i, y + j) for x, y in now.pyramid.tiles(level) for i in (-1, 0, 1) for j in (-1, 0, 1)}
    return [(level, x, y) for x, y in sorted({(x % count, y) for x, y in near if 0 <= y < count})]


def _link(addresses: MapAddresses, level: int, x: int, y: int, from_px: int) -> str:
    address = escape(addresses.of(f"kml/{level}/{x}/{y}.kml"))
    return (
        f"<NetworkLink><name>{level}/{x}/{y}</name><Region>{_box('LatLonAltBox', bounds_of(level, x, y))}"
        f"{_lod(from_px, -1)}</Region>"
        f"<Link><href>{address}</href><viewRefreshMode>onRegion</viewRefreshMode></Link></NetworkLink>"
    )


def _overlay(addresses: MapAddresses, level: int, x: int, y: int, finest: int) -> str:
    """Finer tiles lie above coarser ones, which go when they are stretched too far."""
    bounds, address = bounds_of(level, x, y), escape(addresses.of(f"{level}/{x}/{y}.png"))
    refresh = f"<refreshMode>onInterval</refreshMode><refreshInterval>{PICTURE_S}</refreshInterval>"
    return (
        f"<GroundOverlay><name>{level}/{x}/{y}</name><Region>{_box('LatLonAltBox', bounds)}"
        f"{_lod(0, -1 if level == finest else SHOWN_TO_PX)}</Region><drawOrder>{level}</drawOrder>"
        f"<Icon><href>{address}</href>{refresh}</Icon>{_box('LatLonBox', bounds)}</GroundOverlay>"
    )


def _lod(least_px: int, most_px: int) -> str:
    return f"<Lod><minLodPixels>{least_px}</minLodPixels><maxLodPixels>{most_px}</maxLodPixels></Lod>"


def _look_at(now: MapNow) -> str:
    """Where the view goes when the file is opened."""
    middle, reach = now.pyramid.middle, now.pyramid.reach
    if middle is None or reach is None:
        return ""
    west, south, east, north = reach
    away = max((east - west) * DEGREE_M, (north - south) * DEGREE_M, 100.0)
    return (
        f"<LookAt><longitude>{middle[0]!r}</longitude><latitude>{middle[1]!r}</latitude>"
        f"<altitude>0</altitude><heading>0</heading><tilt>0</tilt><range>{away:.0f}</range></LookAt>"
    )


def bounds_of(level: int, x: int, y: int) -> Bounds:
    """A tile's in degrees."""
    ends = np.array([0.0, TILE_SIZE])
    (west, north), (east, south) = grid_of_tile(level, x, y).places(ends, ends)[[0, 1], [0, 1]].tolist()
    return west, south, 180.0 if east <= west else east, north


def _box(element: str, bounds: Bounds) -> str:
    west, south, east, north = bounds
    return f"<{element}><north>{north!r}</north><south>{south!r}</south><east>{east!r}</east><west>{west!r}</west></{element}>"
