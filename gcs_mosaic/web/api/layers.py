"""Of what was seen: layers over the map, and gaps."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from aiohttp import web

from gcs_mosaic.render.tile_grid import FINEST_LEVEL, Tile
from gcs_mosaic.store.documents import Limits
from gcs_mosaic.views.changes import merged_flights
from gcs_mosaic.views.coverage import footprint_of
from gcs_mosaic.views.flight_view import FlightView
from gcs_mosaic.views.layers import CHANGES, LAYERS, LayerLegend, LayerTiles, area_words, is_possible, legends
from gcs_mosaic.views.thermal_scale import ThermalScale, ThermalScales
from gcs_mosaic.web.api.asked import asked_query
from gcs_mosaic.web.api.common import (
    BASE,
    SLOW_POOL,
    VIEW,
    AskedRevision,
    MapRevision,
    answer,
    in_thread,
    missing,
    told_anew,
)
from gcs_mosaic.web.api.frames import shown_name
from gcs_mosaic.web.api.operations import Media, Operations, Reply
from gcs_mosaic.web.tile_answer import tile_answer

MOST_GAPS = 200  # the largest
TILES = web.AppKey("layer_tiles", LayerTiles)
SCALES = web.AppKey("thermal_scales", ThermalScales)
PLACE = "{island:[0-9]{1,6}}/{z:[0-9]{1,2}}/{x:[0-9]{1,9}}/{y:[0-9]{1,9}}"
REVISION = "Map-Revision"  # that a tile of a layer is of
LAYER_TILE = f"{BASE}/layers/{{layer:[a-z]{{1,20}}}}/{PLACE}.png"


OPERATIONS = Operations()


@dataclass(frozen=True, slots=True, kw_only=True)
class FreshQuery:
    """How new the answer is to be."""

    r: AskedRevision = 0


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
class ChangedGroundAnswer:
    """Ground that two flights show otherwise."""

    x: Annotated[float, "on the island's canvas, its middle"]
    y: float
    area: Annotated[float, "canvas units squared"]
    brighter: Annotated[float, "times as bright in the later flight, where it differs most from all around"]


@dataclass(frozen=True, slots=True, kw_only=True)
class GroundChangesAnswer:
    """Where the last of the merged flights shows something else than those before it, the largest first."""

    map_revision: MapRevision
    flights: Annotated[Sequence[str], "in order of time; none if the map is of one flight"]
    compared: Annotated[int, Limits(least=0), "frames; there are no changes before all are"]
    frames: Annotated[int, Limits(least=0)]
    ground: Annotated[
        float | None, "share of the ground that was seen, of which this tells; null before all are compared"
    ]
    unshown: Annotated[int, Limits(least=0), "of the frames, which cannot be shown and so not be compared"]
    changes: Sequence[ChangedGroundAnswer]


@dataclass(frozen=True, slots=True, kw_only=True)
class ThermalAnswer:
    """What the greys of a thermal map mean."""

    map_revision: MapRevision
    scale: Annotated[ThermalScale | None, "null where frames are ordinary pictures"]


def keep_tiles(app: web.Application) -> None:
    """For requests to come."""
    app[TILES], app[SCALES] = LayerTiles(app[VIEW]), ThermalScales(app[VIEW])


@OPERATIONS.add("GET", f"{BASE}/layers", Reply("The layers.", LayersAnswer))
async def layers(request: web.Request) -> web.StreamResponse:
    """The layers there are, with their legends."""
    merged = await in_thread(request, _is_merged, request.app[VIEW])
    return answer(LayersAnswer(layers=legends(merged=merged)))


@OPERATIONS.add(
    "GET",
    LAYER_TILE,
    Reply("256 x 256 px with alpha.", Media(("image/png",)), tagged=True),
    query=FreshQuery,
    failures={404: "There is no such layer or tile."},
)
async def layer_tile(request: web.Request) -> web.StreamResponse:
    """A tile of a layer, transparent where nothing was seen; the header Map-Revision tells of which of the map's
    revisions, but of what changed between flights, which comes frame by frame."""
    name = request.match_info["layer"]
    island, z, x, y = (int(request.match_info[name]) for name in ("island", "z", "x", "y"))
    if (name not in LAYERS and name != CHANGES) or not is_possible(Tile(z, x, y), FINEST_LEVEL):
        raise missing("There is no such layer or tile.")
    tiles, tile, at_least = request.app[TILES], Tile(z, x, y), asked_query(request, FreshQuery).r
    if name == CHANGES:
        return tile_answer(request, await in_thread(request, tiles.changed, island, tile, pool=SLOW_POOL))
    revision, data = await in_thread(request, tiles.tile, LAYERS[name], island, tile, at_least, pool=SLOW_POOL)
    told = tile_answer(request, data)
    told.headers[REVISION] = str(revision)
    return told


@OPERATIONS.add(
    "GET",
    f"{BASE}/islands/{{island:[0-9]{{1,6}}}}/gaps",
    Reply("The gaps, on the island's canvas.", GapsAnswer),
    query=FreshQuery,
)
async def gaps(request: web.Request) -> web.StreamResponse:
    """Ground inside the flown area that nobody has seen, the largest first."""
    asked, island = asked_query(request, FreshQuery), int(request.match_info["island"])
    return answer(await in_thread(request, _gaps, request.app[VIEW], request.app[TILES], island, asked.r))


@OPERATIONS.add(
    "GET", f"{BASE}/islands/{{island:[0-9]{{1,6}}}}/changes", Reply("What is known so far.", GroundChangesAnswer)
)
async def changes(request: web.Request) -> web.StreamResponse:
    """What changed on an island between merged flights; each question has some more frames compared."""
    island = int(request.match_info["island"])
    return answer(await in_thread(request, _changes, request.app[VIEW], request.app[TILES], island, pool=SLOW_POOL))


def _is_merged(view: FlightView) -> bool:
    return bool(merged_flights(view, view.table())[0])


def _changes(view: FlightView, tiles: LayerTiles, island: int) -> GroundChangesAnswer:
    found = tiles.changes.ask(island)
    areas = [
        ChangedGroundAnswer(
            x=round(one.x, 1), y=round(one.y, 1), area=round(one.area, 1), brighter=round(math.exp(one.contrast), 2)
        )
        for one in found.areas
    ]
    flights, _ = merged_flights(view, view.table())
    named = [shown_name(name) for name in flights]
    return GroundChangesAnswer(
        map_revision=found.revision,
        flights=named,
        compared=found.done,
        frames=found.frames,
        ground=None if found.strength is None else round(found.share, 4),
        unshown=found.unshown,
        changes=areas,
    )


@OPERATIONS.add(
    "GET",
    f"{BASE}/islands/{{island:[0-9]{{1,6}}}}/thermal",
    Reply("What greys mean.", ThermalAnswer, tagged=True),
)
async def thermal(request: web.Request) -> web.StreamResponse:
    """The scale of a thermal map, in degrees Celsius where the camera tells them. The picture does not depend on it."""
    island, scales = int(request.match_info["island"]), request.app[SCALES]
    revision, scale = await in_thread(request, scales.of, island, pool=SLOW_POOL)
    return told_anew(request, ThermalAnswer(map_revision=revision, scale=scale))


def _gaps(view: FlightView, tiles: LayerTiles, island: int, at_least: int) -> GapsAnswer:
    seen = tiles.islands.of(island, at_least)
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
