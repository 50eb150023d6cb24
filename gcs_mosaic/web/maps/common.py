"""What the protocols of the map share: the map that is served, checked addresses, answers."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Literal

from aiohttp import web

from gcs_mosaic.geo.mercator import FINEST_LEVEL
from gcs_mosaic.web.access import MAPS
from gcs_mosaic.web.address import HttpAddress
from gcs_mosaic.web.api.operations import Failures, Handler, Media, Operations, Reply
from gcs_mosaic.web.maps.pictures import MapLook, Suffix
from gcs_mosaic.web.maps.served_map import MapNow, ServedMap
from gcs_mosaic.web.tile_answer import tagged, tile_answer

FLIGHT = MAPS + r"{flight:[A-Za-z0-9._-]{1,80}}"
TILE = "{z:[0-9]{1,2}}/{x:[0-9]{1,9}}/{y:[0-9]{1,9}}"
ISLAND = re.compile("[0-9]{1,6}")
NO_ANCHOR = (
    "Nothing is shown here yet: no island of the flight has an anchor. Set two pins on the page, under Anchor; of pins that are "
    "set it says there why they lay nothing."
)

PICTURES = Media(("image/png", "image/jpeg", "image/webp"))
OF_FLIGHT = {"flight": "The flight's name in addresses, as /maps of this API tells it."}
NOTHING: Failures = {
    404: "Another flight's name, or nothing of that number.",
    503: "The notes, which hold the anchors, cannot be read now.",
}

MAP = web.AppKey("map", ServedMap)
ADDRESS = web.AppKey("address", HttpAddress)
CORS = web.AppKey("cors", bool)


@dataclass(frozen=True, slots=True, kw_only=True)
class TokenQuery:
    """Who asks."""

    token: Annotated[str | None, "for programs that cannot keep a cookie; with GET only"] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class LookQuery(TokenQuery):
    """What is shown."""

    underlay: Annotated[Literal["1"] | None, "over the map that the settings name"] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class TileQuery(LookQuery):
    """What is shown of which island."""

    island: Annotated[int | None, "this one alone"] = None


class MapOperations(Operations):
    """Those under a flight's name, for other programs."""

    def of_map(
        self, path: str, answer: Reply, query: type = TokenQuery, failures: Failures = NOTHING
    ) -> Callable[[Handler], Handler]:
        """Declare what the handler answers to GET."""
        return self.add("GET", f"{FLIGHT}/{path}", answer, query=query, about=OF_FLIGHT, failures=failures)


async def map_now(request: web.Request) -> MapNow:
    """The map as it is now. Raises HTTPNotFound for another flight's name: its tiles are not these."""
    now = await request.app[MAP].now()
    if request.match_info["flight"] != now.flight:
        raise web.HTTPNotFound(
            text=f"This is flight {now.flight}: take its addresses from the page, under On other maps.\n"
        )
    return now


async def tile_of(request: web.Request, level: int, x: int, y: int, look: MapLook) -> web.Response:
    """A tile, or 304."""
    if level > FINEST_LEVEL or max(x, y) >= 1 << level:
        raise web.HTTPNotFound(text="There is no such tile.\n")
    encoded = await request.app[MAP].tile(level, x, y, look)
    return tile_answer(request, encoded.data, encoded.media_type)


def look_of(request: web.Request, suffix: Suffix = "png") -> MapLook:
    """What the query says of island and underlay. Raises HTTPBadRequest."""
    island = request.query.get("island")
    if island is not None and not ISLAND.fullmatch(island):
        raise web.HTTPBadRequest(text="island= is to be the number of an island.\n")
    return MapLook(suffix, None if island is None else int(island), request.query.get("underlay") == "1")


def document(request: web.Request, text: str, media_type: str, download: str | None = None) -> web.Response:
    """A text with an ETag; 304 to whom knows it. `download`: the name of the file as which a browser keeps it."""
    told = tagged(request, text.encode("utf-8", "replace"), media_type, charset="utf-8")
    if download is not None and told.status == 200:
        told.headers["Content-Disposition"] = f'attachment; filename="{download}"'
    return told


def about(now: MapNow) -> str:
    """What is shown, and how exactly, in a sentence or two."""
    if now.error_m is None:
        return NO_ANCHOR
    told = f"The map of the flight {now.title}, ± {math.ceil(now.error_m)} m (95 %) at its worst corner."
    if now.unanchored:
        names = ", ".join(map(str, now.unanchored))
        told += f" Not shown, without an anchor: island {names}."
    return told
