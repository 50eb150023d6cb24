"""Through the trees: the map in focus at the ground instead of the canopy."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, Annotated

from aiohttp import web

from gcs_mosaic.notes.storage.checked import Unfit
from gcs_mosaic.render.tile_grid import FINEST_LEVEL, Tile
from gcs_mosaic.store.documents import Limits
from gcs_mosaic.views.flight_view import FlightView
from gcs_mosaic.views.layers import is_possible
from gcs_mosaic.web.api.asked import asked_query
from gcs_mosaic.web.api.common import (
    BASE,
    VIEW,
    MapRevision,
    OneThread,
    answer,
    beside,
    in_thread,
    map_revision,
    missing,
    steadily,
)
from gcs_mosaic.web.api.layers import PLACE
from gcs_mosaic.web.api.operations import Media, Operations, Reply
from gcs_mosaic.web.tile_answer import tile_answer

if TYPE_CHECKING:
    from gcs_mosaic.integral.ground_tiles import GroundTiles, PartKey

OPERATIONS = Operations()
IDLE_S = 0.3  # between two looks whether somebody wants something
REST = 0.5  # of what a piece of work has taken, before the next: the flight comes first
FORGET_S = 60.0  # after which nobody looks any more
MOST_PARTS = 64
Index = Annotated[int, Limits(least=0, most=(1 << FINEST_LEVEL) - 1)]
# As `integral.flight_looks` has them, which is not loaded before somebody asks.
Height = Annotated[
    float | None,
    Limits(least=-1.5, most=0.5),
    "of the focus above the map's ground everywhere, as a share of the flying height; without it the ground is sought",
]


@dataclass(frozen=True, slots=True, kw_only=True)
class GroundTileQuery:
    """In which focus."""

    height: Height = None
    v: Annotated[str, Limits(longest=40), "anything: so that a browser does not take an old tile for the new one"] = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class GroundQuery:
    """What somebody looks at: tiles of a level, from the left one at the top to the right one at the bottom."""

    z: Annotated[int, Limits(least=0, most=FINEST_LEVEL)]
    left: Index
    top: Index
    right: Index
    bottom: Index
    height: Height = None


@dataclass(frozen=True, slots=True, kw_only=True)
class GroundPartAnswer:
    """A part that was made."""

    x: Annotated[int, Limits(least=0), "of its first tile"]
    y: Annotated[int, Limits(least=0)]
    version: Annotated[int, Limits(least=0), "another one once it was made anew"]


@dataclass(frozen=True, slots=True, kw_only=True)
class GroundAnswer:
    """What there is of what somebody looks at."""

    map_revision: MapRevision
    span: Annotated[int, Limits(least=1), "tiles along a side of a part"]
    parts: Sequence[GroundPartAnswer]
    waiting: Annotated[int, Limits(least=0), "parts that are still to be made, at all or anew"]
    cells: Annotated[int, Limits(least=0), "places at which the ground was sought"]
    known: Annotated[int, Limits(least=0), "of these, at which it was found"]
    lost: Annotated[int, Limits(least=0), "frames whose originals cannot be read, of the part that misses most"]
    trouble: Annotated[str, "why a part shows nothing, in a sentence"]


class GroundThread:
    """One thread, which rests between two frames, for as long as somebody looks. It is as patient as the page's process is: a
    thread that were more so would hold the interpreter, and with it all answers, while it waits for the processor."""

    def __init__(self, view: FlightView) -> None:
        self._view = view
        self._thread = OneThread("ground", MOST_PARTS)
        self._tiles: GroundTiles | None = None
        self._last = math.inf  # piece of work

    def tiles(self) -> GroundTiles:
        """Made when somebody asks: it loads what decodes."""
        from gcs_mosaic.integral.ground_tiles import GroundTiles

        self._tiles = self._tiles or GroundTiles(self._view)
        return self._tiles

    async def step(self) -> bool:
        """A piece of work, and the rest after it; False if there is nothing to do."""
        begun = time.monotonic()
        if self._tiles is None:
            return False
        if await self._thread.run_anyway(self._tiles.step):
            self._last = time.monotonic()
            await asyncio.sleep(REST * (self._last - begun))
            return True
        if begun - self._last > FORGET_S:
            self._last = math.inf
            await self._thread.run_anyway(self._tiles.forget)
        return False

    def end(self) -> None:
        self._thread.end()


GROUND = web.AppKey("ground", GroundThread)


def add_ground(app: web.Application) -> None:
    """Look through the trees as long as the application runs."""
    app[GROUND] = GroundThread(app[VIEW])
    app.cleanup_ctx.append(beside(_make_for_ever, _ended))


@OPERATIONS.add(
    "GET",
    f"{BASE}/ground/{PLACE}.webp",
    Reply("256 x 256 px with alpha.", Media(("image/webp", "image/png")), tagged=True),
    query=GroundTileQuery,
    failures={404: "There is no such tile."},
)
async def ground_tile(request: web.Request) -> web.StreamResponse:
    """A tile in focus at the ground, as it was made last; transparent where fewer than two frames see something, and where nobody
    has asked yet what there is."""
    tile, island = Tile(*(int(request.match_info[name]) for name in "zxy")), int(request.match_info["island"])
    if not is_possible(tile, FINEST_LEVEL):
        raise missing("There is no such tile.")
    tiles = await in_thread(request, request.app[GROUND].tiles)
    return tile_answer(
        request, tiles.tile(island, tile, _height(asked_query(request, GroundTileQuery).height)), "image/webp"
    )


@OPERATIONS.add(
    "GET",
    f"{BASE}/islands/{{island:[0-9]{{1,6}}}}/ground",
    Reply("What was made of it so far.", GroundAnswer),
    query=GroundQuery,
)
async def ground(request: web.Request) -> web.StreamResponse:
    """What is seen through the trees of some tiles; asking has them made, the middle ones first."""
    asked, revision = asked_query(request, GroundQuery), await map_revision(request)
    tiles = await in_thread(request, request.app[GROUND].tiles)
    keys = await in_thread(request, _parts, int(request.match_info["island"]), asked)
    tiles.want(keys)
    found = await in_thread(request, tiles.parts, keys)
    made = [part for _, part, _ in found if part is not None]
    told = GroundAnswer(
        map_revision=revision,
        span=_span(),
        parts=[
            GroundPartAnswer(x=key.column * _span(), y=key.row * _span(), version=part.version)
            for key, part, _ in found
            if part is not None
        ],
        waiting=sum(is_old for *_, is_old in found),
        cells=sum(part.cells for part in made),
        known=sum(part.known for part in made),
        lost=max((part.lost for part in made), default=0),
        trouble=next((part.trouble for part in made if part.trouble), ""),
    )
    return answer(told)


def _parts(island: int, asked: GroundQuery) -> list[PartKey]:
    """Those that hold the tiles, from the middle outwards. Raises Unfit."""
    from gcs_mosaic.integral.ground_tiles import PartKey

    most = (1 << asked.z) - 1
    ends = [(min(first, most) // _span(), min(last, most) // _span()) for first, last in _sides(asked)]
    counts = [max(0, last - first + 1) for first, last in ends]
    if math.prod(counts) > MOST_PARTS:
        raise Unfit(
            f"left, top, right and bottom are to hold {MOST_PARTS} parts at most, of {_span()} x {_span()} tiles."
        )
    middle = [(first + last) / 2 for first, last in ends]
    columns, rows = (range(first, first + count) for (first, _), count in zip(ends, counts, strict=True))
    places = sorted(product(columns, rows), key=lambda one: math.dist(one, middle))
    return [PartKey(island, asked.z, column, row, _height(asked.height)) for column, row in places]


def _sides(asked: GroundQuery) -> tuple[tuple[int, int], tuple[int, int]]:
    return (asked.left, asked.right), (asked.top, asked.bottom)


def _span() -> int:
    from gcs_mosaic.integral.ground_tiles import SPAN

    return SPAN


def _height(asked: float | None) -> float | None:
    """In steps of a thousandth: what is finer is the same focus."""
    return None if asked is None else round(asked, 3)


async def _make_for_ever(app: web.Application) -> None:
    await steadily(app[GROUND].step, IDLE_S)


async def _ended(app: web.Application) -> None:
    app[GROUND].end()
