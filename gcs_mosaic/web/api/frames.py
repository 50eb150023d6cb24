"""Of places and frames: who saw a place, and the originals."""

from __future__ import annotations

import asyncio
from dataclasses import asdict
from datetime import UTC, datetime
from urllib.parse import quote

from aiohttp import web

from gcs_mosaic.views.picture_tiles import KEPT_S, PictureTiles
from gcs_mosaic.views.pictures import REDUCTIONS, NoPicture, Original, is_shown_as_it_is, original, picture
from gcs_mosaic.views.sightings import Sighting, sightings
from gcs_mosaic.web.api.common import BASE, VIEW, answer, bad, in_thread, missing, number

LARGEST_CROP = 1024  # px
CROP_KEPT_S = 3600  # by the browser: a frame's content does not change
CHUNK = 1 << 16  # bytes in memory for each browser that takes an original
ISLAND = f"{BASE}/islands/{{island:[0-9]{{1,6}}}}"
PIECES = web.AppKey("pieces", PictureTiles)
FRAME = f"{BASE}/frames/{{frame:[0-9]{{1,9}}}}"


def add_routes(app: web.Application) -> None:
    app.router.add_get(f"{ISLAND}/sightings", who_saw)
    app.router.add_get(f"{FRAME}/picture", shown)
    app.router.add_get(f"{FRAME}/pieces/{{column:[0-9]{{1,4}}}}/{{row:[0-9]{{1,4}}}}.jpg", piece)
    app.router.add_get(f"{FRAME}/crop.jpg", crop)
    app.router.add_get(f"{FRAME}/original", download)
    app[PIECES] = PictureTiles()


async def who_saw(request: web.Request) -> web.StreamResponse:
    """GET ?x=&y=: the frames that saw a place on an island's canvas, the best first."""
    x, y = number(request, "x"), number(request, "y")
    found = await in_thread(request, sightings, request.app[VIEW], int(request.match_info["island"]), x, y)
    await in_thread(request, _get_ready)
    return answer({"sightings": [_entry(one) for one in found]})


async def shown(request: web.Request) -> web.StreamResponse:
    """GET ?reduction=1|2|4: a frame as a browser can show it, the original file itself where that can be."""
    wanted = request.query.get("reduction", "1")
    if wanted not in map(str, REDUCTIONS):
        raise bad(f"reduction= is to be one of {', '.join(map(str, REDUCTIONS))}.")
    view, frame, reduction = request.app[VIEW], int(request.match_info["frame"]), int(wanted)
    source = await _source(request)
    etag = f"{source.shown_as}-{reduction}"
    if any(known.value == etag for known in request.if_none_match or ()):
        return web.Response(status=304, headers={"ETag": f'"{etag}"'})
    if reduction == 1 and is_shown_as_it_is(source):
        return web.FileResponse(
            source.path, CHUNK, headers={"Content-Type": source.media_type or "", "ETag": f'"{etag}"'}
        )
    try:
        data, kind = await in_thread(request, picture, view, frame, reduction)
    except NoPicture as error:
        raise missing(str(error)) from error
    return web.Response(body=data, content_type=kind, headers={"ETag": f'"{etag}"'})


async def piece(request: web.Request) -> web.StreamResponse:
    """GET: 512 x 512 px of a frame as it is shown, at full resolution; for large ones."""
    frame, column, row = (int(request.match_info[name]) for name in ("frame", "column", "row"))
    source = await _source(request)
    etag = f"{source.shown_as}-{column}-{row}"
    if any(known.value == etag for known in request.if_none_match or ()):
        return web.Response(status=304, headers={"ETag": f'"{etag}"'})
    pieces = request.app[PIECES]
    try:
        data = await in_thread(request, pieces.piece, request.app[VIEW], frame, column, row)
    except NoPicture as error:
        raise missing(str(error)) from error
    finally:
        asyncio.get_running_loop().call_later(KEPT_S + 1, pieces.forget)
    return web.Response(body=data, content_type="image/jpeg", headers={"ETag": f'"{etag}"'})


async def crop(request: web.Request) -> web.StreamResponse:
    """GET ?x=&y=&side=: the square about a pixel of a frame as it is shown, at full resolution."""
    frame, x, y = int(request.match_info["frame"]), number(request, "x"), number(request, "y")
    side = int(number(request, "side", least=16, most=LARGEST_CROP))
    source = await _source(request)
    etag = f"{source.shown_as}-{x:.0f}-{y:.0f}-{side}"
    headers = {"ETag": f'"{etag}"', "Cache-Control": f"private, max-age={CROP_KEPT_S}"}
    if any(known.value == etag for known in request.if_none_match or ()):
        return web.Response(status=304, headers=headers)
    pieces = request.app[PIECES]
    try:
        data = await in_thread(request, pieces.crop, request.app[VIEW], frame, x, y, side)
    except NoPicture as error:
        raise missing(str(error)) from error
    finally:
        asyncio.get_running_loop().call_later(KEPT_S + 1, pieces.forget)
    return web.Response(body=data, content_type="image/jpeg", headers=headers)


async def download(request: web.Request) -> web.StreamResponse:
    """GET: the original file, under its own name."""
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


def _entry(one: Sighting) -> dict[str, object]:
    when = None if one.utc is None else datetime.fromtimestamp(one.utc, UTC).isoformat(timespec="milliseconds")
    entry = asdict(one) | {
        "time": when and when.replace("+00:00", "Z"),
        "name": one.name.encode("utf-8", "replace").decode(),
    }
    entry.pop("utc")
    return entry
