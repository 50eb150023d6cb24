"""Of what was seen: layers over the map, and gaps."""

from __future__ import annotations

from typing import Any

import numpy as np
from aiohttp import web

from gcs_mosaic.render.tile_grid import FINEST_LEVEL, Tile
from gcs_mosaic.views.coverage import footprint_of
from gcs_mosaic.views.flight_view import FlightView
from gcs_mosaic.views.layers import LAYERS, LayerTiles, area_words, is_possible, legend
from gcs_mosaic.web.api.common import BASE, VIEW, answer, in_thread, missing
from gcs_mosaic.web.tile_answer import tile_answer

MOST_GAPS = 200  # the largest
TILES = web.AppKey("layer_tiles", LayerTiles)
PLACE = "{island:[0-9]{1,6}}/{z:[0-9]{1,2}}/{x:[0-9]{1,9}}/{y:[0-9]{1,9}}"
LAYER_TILE = f"{BASE}/layers/{{layer:[a-z]{{1,20}}}}/{PLACE}.png"


def add_routes(app: web.Application) -> None:
    app[TILES] = LayerTiles(app[VIEW])
    app.router.add_get(f"{BASE}/layers", layers)
    app.router.add_get(LAYER_TILE, layer_tile)
    app.router.add_get(f"{BASE}/islands/{{island:[0-9]{{1,6}}}}/gaps", gaps)


async def layers(_request: web.Request) -> web.StreamResponse:
    """GET: the layers there are, with their legends."""
    return answer({"layers": [legend(layer) for layer in LAYERS.values()]})


async def layer_tile(request: web.Request) -> web.StreamResponse:
    """GET: a tile of a layer."""
    layer = LAYERS.get(request.match_info["layer"])
    island, z, x, y = (int(request.match_info[name]) for name in ("island", "z", "x", "y"))
    if layer is None or not is_possible(Tile(z, x, y), FINEST_LEVEL):
        raise missing("There is no such layer or tile.")
    data = await in_thread(request, request.app[TILES].tile, layer, island, Tile(z, x, y))
    return tile_answer(request, data)


async def gaps(request: web.Request) -> web.StreamResponse:
    """GET: ground inside the flown area that nobody has seen, the largest first; places are on the island's canvas."""
    found = await in_thread(request, _gaps, request.app[VIEW], request.app[TILES], int(request.match_info["island"]))
    return answer({"gaps": found})


def _gaps(view: FlightView, tiles: LayerTiles, island: int) -> list[dict[str, Any]]:
    _, found = tiles.islands.of(island)
    table = view.table()
    footprint = footprint_of(table.boxes[table.islands == island]) if found else 0.0
    return [
        {
            "outline": np.round(gap.outline, 1).tolist(),
            "inside": np.round(gap.inside, 1).tolist(),
            "area": round(gap.area, 1),
            "words": area_words(gap.area, footprint),
        }
        for gap in found[:MOST_GAPS]
    ]
