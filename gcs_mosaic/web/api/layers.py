"""Of what was seen: layers over the map, and gaps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from aiohttp import web

from gcs_mosaic.render.tile_grid import FINEST_LEVEL, Tile
from gcs_mosaic.views.coverage import footprint_of
from gcs_mosaic.views.flight_view import FlightView
from gcs_mosaic.views.layers import LAYERS, LayerLegend, LayerTiles, area_words, is_possible, legend
from gcs_mosaic.views.thermal_scale import ThermalScale, ThermalScales
from gcs_mosaic.web.api.common import BASE, VIEW, MapRevision, answer, in_thread, missing, told_anew
from gcs_mosaic.web.api.operations import Media, Operations, Reply
from gcs_mosaic.web.tile_answer import tile_answer

MOST_GAPS = 200  # the largest
TILES = web.AppKey("layer_tiles", LayerTiles)
SCALES = web.AppKey("thermal_scales", ThermalScales)
PLACE = "{island:[0-9]{1,6}}/{z:[0-9]{1,2}}/{x:[0-9]{1,9}}/{y:[0-9]{1,9}}"
LAYER_TILE = f"{BASE}/layers/{{layer:[a-z]{{1,20}}}}/{PLACE}.png"


OPERATIONS = Operations()


@dataclass(frozen=True, slots=True, kw_only=True)
class LayersAnswer:
    """The layers there are."""

    layers: Sequence[LayerLegend]


@dataclass(frozen=True, slots=True, kw_only=True)
class GapAnswer:
    """Ground inside the flown area that nobody has seen."""

    outline: Annotated[Sequence[tuple[float, float]], "x, y on the island's canvas"]
    inside: Annotated[tuple[float, float], "a point well within it"]
    area: Annotated[float, "canvas units squared"]
    words: Annotated[str, "how large it is, compared with a frame"]


@dataclass(frozen=True, slots=True, kw_only=True)
class GapsAnswer:
    """The gaps, on the island's canvas."""

    map_revision: MapRevision
    gaps: Sequence[GapAnswer]


@dataclass(frozen=True, slots=True, kw_only=True)
class ThermalAnswer:
    """What the greys of a thermal map mean."""

    map_revision: MapRevision
    scale: Annotated[ThermalScale | None, "null where frames are ordinary pictures"]


def keep_tiles(app: web.Application) -> None:
    """For requests to come."""
    app[TILES], app[SCALES] = LayerTiles(app[VIEW]), ThermalScales(app[VIEW])


@OPERATIONS.add("GET", f"{BASE}/layers", Reply("The layers.", LayersAnswer))
async def layers(_request: web.Request) -> web.StreamResponse:
    """The layers there are, with their legends."""
    return answer(LayersAnswer(layers=[legend(layer) for layer in LAYERS.values()]))


@OPERATIONS.add(
    "GET",
    LAYER_TILE,
    Reply("256 x 256 px with alpha.", Media(("image/png",)), tagged=True),
    failures={404: "There is no such layer or tile."},
)
async def layer_tile(request: web.Request) -> web.StreamResponse:
    """A tile of a layer, transparent where nothing was seen."""
    layer = LAYERS.get(request.match_info["layer"])
    island, z, x, y = (int(request.match_info[name]) for name in ("island", "z", "x", "y"))
    if layer is None or not is_possible(Tile(z, x, y), FINEST_LEVEL):
        raise missing("There is no such layer or tile.")
    data = await in_thread(request, request.app[TILES].tile, layer, island, Tile(z, x, y))
    return tile_answer(request, data)


@OPERATIONS.add(
    "GET", f"{BASE}/islands/{{island:[0-9]{{1,6}}}}/gaps", Reply("The gaps, on the island's canvas.", GapsAnswer)
)
async def gaps(request: web.Request) -> web.StreamResponse:
    """Ground inside the flown area that nobody has seen, the largest first."""
    found = await in_thread(request, _gaps, request.app[VIEW], request.app[TILES], int(request.match_info["island"]))
    return answer(found)


@OPERATIONS.add(
    "GET",
    f"{BASE}/islands/{{island:[0-9]{{1,6}}}}/thermal",
    Reply("What greys mean.", ThermalAnswer, tagged=True),
)
async def thermal(request: web.Request) -> web.StreamResponse:
    """The scale of a thermal map, in degrees Celsius where the camera tells them. The picture does not depend on it."""
    revision, scale = await in_thread(request, request.app[SCALES].of, int(request.match_info["island"]))
    return told_anew(request, ThermalAnswer(map_revision=revision, scale=scale))


def _gaps(view: FlightView, tiles: LayerTiles, island: int) -> GapsAnswer:
    seen = tiles.islands.of(island)
    table = view.table()
    footprint = footprint_of(table.boxes[table.islands == island]) if seen.gaps else 0.0
    told = [
        GapAnswer(
            outline=np.round(gap.outline, 1).tolist(),
            inside=np.round(gap.inside, 1).tolist(),
            area=round(gap.area, 1),
            words=area_words(gap.area, footprint),
        )
        for gap in seen.gaps[:MOST_GAPS]
    ]
    return GapsAnswer(map_revision=seen.revision, gaps=told)
