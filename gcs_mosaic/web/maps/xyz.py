"""XYZ tiles and their TileJSON, for QGroundControl, QGIS, Leaflet, MapLibre, OpenLayers and many more."""

from __future__ import annotations

import json
from typing import Any, cast

from aiohttp import web

from gcs_mosaic.geotiles.pyramid import OVERZOOM
from gcs_mosaic.web.api.operations import Reply
from gcs_mosaic.web.maps.addresses import addresses_for
from gcs_mosaic.web.maps.common import (
    PICTURES,
    TILE,
    LookQuery,
    MapOperations,
    TileQuery,
    about,
    document,
    look_of,
    map_now,
    tile_of,
)
from gcs_mosaic.web.maps.pictures import Suffix

OPERATIONS = MapOperations()


@OPERATIONS.of_map(f"{TILE}.{{suffix:(png|jpg|webp)}}", Reply("The tile.", PICTURES, tagged=True), query=TileQuery)
async def tile(request: web.Request) -> web.StreamResponse:
    """An XYZ tile of 256 px (EPSG:3857); transparent where nothing was seen, never 404 within the grid."""
    await map_now(request)
    level, x, y = (int(request.match_info[name]) for name in ("z", "x", "y"))
    return await tile_of(request, level, x, y, look_of(request, cast("Suffix", request.match_info["suffix"])))


@OPERATIONS.of_map("tilejson.json", Reply("The document.", dict, tagged=True), query=LookQuery)
async def tilejson(request: web.Request) -> web.StreamResponse:
    """TileJSON 3.0; `revision` is another whenever something looks different."""
    now = await map_now(request)
    addresses = addresses_for(request, now.flight)
    told: dict[str, Any] = {
        "tilejson": "3.0.0",
        "tiles": [addresses.xyz],
        "scheme": "xyz",
        "name": now.title,
        "description": about(now),
        "version": "1.0.0",
        "revision": now.token,
        "vector_layers": [],
    }
    levels, bounds, middle = now.pyramid.levels, now.pyramid.bounds, now.pyramid.middle
    if levels is not None and bounds is not None and middle is not None:
        west, south, east, north = bounds
        told |= {"minzoom": levels[0], "maxzoom": levels[1], "bounds": [west, south, east, north]}
        told |= {
            "center": [*middle, max(levels[1] - 2, levels[0])],
            "maxzoom_served": levels[1] + OVERZOOM,
        }
    return document(request, json.dumps(told), "application/json")
