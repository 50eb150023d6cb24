"""The flight's own tiles, on the canvas of an island."""

from __future__ import annotations

import asyncio
import re
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

from aiohttp import web

from gcs_mosaic.render.tile_grid import FINEST_LEVEL, Tile
from gcs_mosaic.store.tiles import ReadMask
from gcs_mosaic.views.tile_reader import EncodedTile, filled
from gcs_mosaic.web.answered_tiles import AnsweredTiles
from gcs_mosaic.web.api.operations import Media, Operations, Reply
from gcs_mosaic.web.choosing import ROOT
from gcs_mosaic.web.tile_answer import tile_answer

TILE_PATH = r"/tiles/{island:[0-9]{1,6}}/{z:[0-9]{1,2}}/{x:[0-9]{1,9}}/{y:[0-9]{1,9}}{suffix:(\.[a-z]{3,4})?}"
REVISION = re.compile("[0-9]{1,18}")
GONE = "The flight's folder is gone: put it back where it was.\n"

ANSWERED = web.AppKey("answered", AnsweredTiles)
TILE_POOL = web.AppKey("tile_pool", ThreadPoolExecutor)

OPERATIONS = Operations()


@dataclass(frozen=True, slots=True, kw_only=True)
class RevisionQuery:
    """How new it is to be."""

    r: Annotated[str | None, "a revision: as the tile was then, or is now"] = None


@OPERATIONS.add(
    "GET",
    TILE_PATH,
    Reply(
        "256 x 256 px, transparent where nothing was seen.",
        Media(("image/jpeg", "image/png", "image/webp")),
        tagged=True,
    ),
    query=RevisionQuery,
    failures={404: "There is no such tile.", 503: "The flight's folder is gone."},
    about={"suffix": "may be left out"},
)
async def tile(request: web.Request) -> web.StreamResponse:
    """One tile with its holes filled."""
    island, wanted = requested_tile(request)
    pool, kept = request.app[TILE_POOL], request.app[ANSWERED]
    revision = request.query.get("r", "")
    least = int(revision) if REVISION.fullmatch(revision) else 0
    make = partial(made, request.app[ROOT], island, wanted, kept.masks(least))
    try:
        encoded = await asyncio.get_running_loop().run_in_executor(pool, kept.get, island, wanted, least, make)
    except FileNotFoundError as error:
        raise web.HTTPServiceUnavailable(text=GONE) from error
    if encoded is None:
        return tile_answer(request, None)
    return tile_answer(request, encoded.data, encoded.media_type)


def made(
    root: Path, island: int, wanted: Tile, masks: ReadMask, before: EncodedTile | None = None
) -> EncodedTile | None:
    """As `tile_reader.filled`. Raises FileNotFoundError where the flight's folder is gone: nobody can tell then what was seen."""
    encoded = filled(root, island, wanted, masks, before)
    if encoded is None and not root.is_dir():
        raise FileNotFoundError(root)
    return encoded


def requested_tile(request: web.Request) -> tuple[int, Tile]:
    """Island and tile of a request's path. Raises HTTPNotFound for a tile outside the grid."""
    island, z, x, y = (int(request.match_info[name]) for name in ("island", "z", "x", "y"))
    if z > FINEST_LEVEL or max(x, y) >= 1 << z:
        raise web.HTTPNotFound(text="There is no such tile.\n")
    return island, Tile(z, x, y)
