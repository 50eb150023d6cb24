"""Of places and frames: who saw a place, and the originals."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Literal
from urllib.parse import quote

from aiohttp import web

from gcs_mosaic.errors import UsageError
from gcs_mosaic.store.documents import Limits
from gcs_mosaic.views.flight_view import FlightView
from gcs_mosaic.views.picture_tiles import KEPT_S, PictureTiles
from gcs_mosaic.views.pictures import NoPicture, Original, is_shown_as_it_is, original, picture
from gcs_mosaic.views.sightings import Sighting, sightings
from gcs_mosaic.views.taken import CaptureTime, Clock
from gcs_mosaic.web.api.asked import asked_query
from gcs_mosaic.web.api.common import (
    BASE,
    SLOW_POOL,
    VIEW,
    AskedRevision,
    MapRevision,
    answer,
    in_thread,
    map_revision,
    missing,
    told_anew,
)
from gcs_mosaic.web.api.operations import Media, Operations, Reply
from gcs_mosaic.web.api.schema import fields_of
from gcs_mosaic.web.tile_answer import is_known

logger = logging.getLogger(__name__)

LARGEST_CROP = 1024  # px
CROP_KEPT_S = 3600  # by the browser: a frame's content does not change
CHUNK = 1 << 16  # bytes in memory for each browser that takes an original
ISLAND = f"{BASE}/islands/{{island:[0-9]{{1,6}}}}"
PIECES = web.AppKey("pieces", PictureTiles)
FRAME = f"{BASE}/frames/{{frame:[0-9]{{1,9}}}}"


OPERATIONS = Operations()
Far = Annotated[float, Limits(least=-1e9, most=1e9)]
NO_PICTURE = {404: "There is no such frame, or no picture of it."}
JPEG = Media(("image/jpeg",))
FILE = Media(("application/octet-stream", "image/*"))
SHOWN = Media(("image/*",))


When = Annotated[
    str | None,
    "when it was taken, ISO 8601: in UTC, but by the camera's clock without a zone, which that does not tell",
]
TimeBy = Annotated[
    Clock | None, "file: not known when it was taken, and `time` is that of its file, about when it came"
]


@dataclass(frozen=True, slots=True, kw_only=True)
class PlaceQuery:
    """A place on an island's canvas."""

    x: Annotated[Far, "canvas units"]
    y: Far


@dataclass(frozen=True, slots=True, kw_only=True)
class SightingsQuery(PlaceQuery):
    """A place on an island's canvas, and how new the answer is to be."""

    r: AskedRevision = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class PictureQuery:
    """How much smaller."""

    reduction: Annotated[Literal[1, 2, 4], "so many times less wide and high"] = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class CropQuery:
    """A square about a pixel."""

    x: Annotated[Far, "pixel of the original"]
    y: Far
    side: Annotated[int, Limits(least=16, most=LARGEST_CROP), "px"]


@dataclass(frozen=True, slots=True, kw_only=True)
class SightingAnswer:
    """One frame's look at a place. Pixels are those of the original file, counted from the centre of its top left one."""

    number: int
    name: str
    width: Annotated[int, "px"]
    height: Annotated[int, "px"]
    x: Annotated[float, "px, where the place is"]
    y: Annotated[float, "px"]
    canvas_per_px: Annotated[float, "ground resolution at this spot, canvas units per pixel"]
    border_px: Annotated[float, "from the frame's border"]
    covered: Annotated[bool, "it is not painted itself: another frame shows all that it does"]
    sharpness: Annotated[float | None, "of the frame's details, to compare frames by; null where it was not noted"]
    as_sharp: Annotated[float, "its sharpness as a share of that of the sharpest look at this place"]
    time: When
    time_by: TimeBy


@dataclass(frozen=True, slots=True, kw_only=True)
class SightingsAnswer:
    """The frames that saw a place."""

    map_revision: MapRevision
    sightings: Sequence[SightingAnswer]


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameTimeAnswer:
    """When a frame on the map was taken."""

    name: str
    time: When
    time_by: TimeBy


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameTimesAnswer:
    """When the frames on the map were taken, in the order in which they came."""

    map_revision: MapRevision
    frames: Sequence[FrameTimeAnswer]


def keep_pieces(app: web.Application) -> None:
    """For requests to come."""
    app[PIECES] = PictureTiles()


@OPERATIONS.add(
    "GET",
    f"{ISLAND}/sightings",
    Reply("The frames, each with the pixel of its original.", SightingsAnswer),
    query=SightingsQuery,
)
async def who_saw(request: web.Request) -> web.StreamResponse:
    """The frames that saw a place on an island's canvas, the best first."""
    asked, island = asked_query(request, SightingsQuery), int(request.match_info["island"])
    revision = await map_revision(request, asked.r)
    found = await in_thread(request, sightings, request.app[VIEW], island, asked.x, asked.y)
    request.app[SLOW_POOL].submit(_get_ready)  # nobody waits for it
    return answer(SightingsAnswer(map_revision=revision, sightings=[_entry(one) for one in found]))


@OPERATIONS.add("GET", f"{BASE}/times", Reply("The times.", FrameTimesAnswer, tagged=True))
async def times(request: web.Request) -> web.StreamResponse:
    """When the frames on the map were taken."""
    try:
        told = await in_thread(request, _times, request.app[VIEW])
    except UsageError:
        logger.info("no ledger can be read", exc_info=True)
        told = FrameTimesAnswer(map_revision=0, frames=[])
    return told_anew(request, told)


@OPERATIONS.add(
    "GET",
    f"{FRAME}/picture",
    Reply("A picture that browsers show.", SHOWN, tagged=True, ranged=True),
    query=PictureQuery,
    failures=NO_PICTURE,
)
async def shown(request: web.Request) -> web.StreamResponse:
    """A frame as a browser can show it, reduced or not; the original file itself where that can be."""
    reduction = asked_query(request, PictureQuery).reduction
    view, frame = request.app[VIEW], int(request.match_info["frame"])
    source = await _source(request)
    etag = f"{source.shown_as}-{reduction}"
    if is_known(request, etag):
        return web.Response(status=304, headers={"ETag": f'"{etag}"'})
    if reduction == 1 and is_shown_as_it_is(source):
        return web.FileResponse(
            source.path, CHUNK, headers={"Content-Type": source.media_type or "", "ETag": f'"{etag}"'}
        )
    try:
        data, kind = await in_thread(request, picture, view, frame, reduction, pool=SLOW_POOL)
    except NoPicture as error:
        raise missing(str(error)) from error
    return web.Response(body=data, content_type=kind, headers={"ETag": f'"{etag}"'})


@OPERATIONS.add(
    "GET",
    f"{FRAME}/pieces/{{column:[0-9]{{1,4}}}}/{{row:[0-9]{{1,4}}}}.jpg",
    Reply("A piece; smaller at the borders.", JPEG, tagged=True),
    failures=NO_PICTURE,
)
async def piece(request: web.Request) -> web.StreamResponse:
    """512 x 512 px of a large frame as it is shown, at full resolution."""
    column, row = (int(request.match_info[name]) for name in ("column", "row"))
    return await _cut(request, f"{column}-{row}", request.app[PIECES].piece, column, row)


@OPERATIONS.add(
    "GET",
    f"{FRAME}/crop.jpg",
    Reply("The square, moved to lie within the frame.", JPEG, tagged=True),
    query=CropQuery,
    failures=NO_PICTURE,
)
async def crop(request: web.Request) -> web.StreamResponse:
    """The square about a pixel of a frame as it is shown, at full resolution."""
    asked = asked_query(request, CropQuery)
    x, y, side = asked.x, asked.y, asked.side
    told = await _cut(request, f"{x:.0f}-{y:.0f}-{side}", request.app[PIECES].crop, x, y, side)
    told.headers["Cache-Control"] = f"private, max-age={CROP_KEPT_S}"
    return told


async def _cut(request: web.Request, where: str, cut: Callable[..., bytes], *of_frame: float) -> web.Response:
    """What is cut out of the frame, or 304."""
    etag = f"{(await _source(request)).shown_as}-{where}"
    if is_known(request, etag):
        return web.Response(status=304, headers={"ETag": f'"{etag}"'})
    try:
        frame = int(request.match_info["frame"])
        data = await in_thread(request, cut, request.app[VIEW], frame, *of_frame, pool=SLOW_POOL)
    except NoPicture as error:
        raise missing(str(error)) from error
    finally:
        asyncio.get_running_loop().call_later(KEPT_S + 1, request.app[PIECES].forget)
    return web.Response(body=data, content_type="image/jpeg", headers={"ETag": f'"{etag}"'})


@OPERATIONS.add(
    "GET", f"{FRAME}/original", Reply("The file as it came.", FILE, tagged=True, ranged=True), failures=NO_PICTURE
)
async def download(request: web.Request) -> web.StreamResponse:
    """The original file under its own name."""
    source = await _source(request)
    name = quote(source.name.rsplit("/", 1)[-1].encode("utf-8", "replace"), safe="")
    headers = {
        "Content-Type": source.media_type or "application/octet-stream",
        "Content-Disposition": f"attachment; filename*=UTF-8''{name}",
    }
    return web.FileResponse(source.path, CHUNK, headers=headers)


def _get_ready() -> None:
    """Who has asked who saw a place looks at an original next."""
    from gcs_mosaic.views.decoding import get_ready  # only once somebody asks

    get_ready()


async def _source(request: web.Request) -> Original:
    try:
        return await in_thread(request, original, request.app[VIEW], int(request.match_info["frame"]))
    except NoPicture as error:
        raise missing(str(error)) from error


def _entry(one: Sighting) -> SightingAnswer:
    told = {name: getattr(one, name) for name in fields_of(SightingAnswer) if name not in ("name", "time", "time_by")}
    taken = None if one.utc is None or one.clock is None else CaptureTime(one.utc, one.clock)
    return SightingAnswer(
        **told, name=shown_name(one.name), time=None if taken is None else taken.iso(), time_by=one.clock
    )


def _times(view: FlightView) -> FrameTimesAnswer:
    """Raises UsageError."""
    table = view.table()
    times = view.capture_times(table)
    taken = [(one.name, times.get(one.number)) for one in table.frames]
    found = [
        FrameTimeAnswer(
            name=shown_name(name), time=None if at is None else at.iso(), time_by=None if at is None else at.by
        )
        for name, at in taken
    ]
    return FrameTimesAnswer(map_revision=table.revision, frames=found)


def shown_name(name: str) -> str:
    """A frame's name as JSON can hold it."""
    return name.encode("utf-8", "replace").decode()
