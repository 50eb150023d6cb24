"""The page's HTTP application: a flight's output folder, read-only but for the choice of an aircraft
(`choosing`) and for notes (`api/notes`), which are no part of the flight.

Runs beside a live flight, which passes it a Feed, or on its own, polling mosaic.json.
"""

from __future__ import annotations

import asyncio
import json
import os
import re
from collections.abc import AsyncIterator, Callable, Coroutine
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from pathlib import Path

from aiohttp import web
from aiohttp.typedefs import Handler

from gcs_mosaic.hints.settings import HintSettings
from gcs_mosaic.render.tile_grid import FINEST_LEVEL, Tile
from gcs_mosaic.store import inside
from gcs_mosaic.store.journal import JOURNAL_NAME, told_after
from gcs_mosaic.store.reading import LARGEST_DOCUMENT
from gcs_mosaic.store.revision import last_revision
from gcs_mosaic.views.tile_reader import filled
from gcs_mosaic.web.access import access_check, is_local
from gcs_mosaic.web.address import HttpAddress, network_names, own_names
from gcs_mosaic.web.address_quota import AddressQuota, origin_of
from gcs_mosaic.web.answered_tiles import AnsweredTiles
from gcs_mosaic.web.api.common import VIEW
from gcs_mosaic.web.api.routes import add_api
from gcs_mosaic.web.change import Change, NotesChange
from gcs_mosaic.web.choosing import ACCESS, CHOOSING, PATH, ROOT, choose_vehicle
from gcs_mosaic.web.feed import Feed, News
from gcs_mosaic.web.guard import add_headers, dates_check, host_check, origin_check
from gcs_mosaic.web.hidden_paths import without_paths
from gcs_mosaic.web.maps.routes import add_maps
from gcs_mosaic.web.request_handler import TimedRequestHandler
from gcs_mosaic.web.settings import WebSettings
from gcs_mosaic.web.tile_answer import tagged, tile_answer
from gcs_mosaic.web.token import Access

VIEWER = Path(__file__).parent / "viewer"
DOCUMENTS = ("mosaic.json", "placements.json")
STATUS = "status.json"
TILE_PATH = r"/tiles/{island:[0-9]{1,6}}/{z:[0-9]{1,2}}/{x:[0-9]{1,9}}/{y:[0-9]{1,9}}{suffix:(\.[a-z]{3,4})?}"
REVISION = re.compile("[0-9]{1,18}")

HEARTBEAT_S = 15.0  # keeps NAT entries alive, and detects pages that are gone
SEND_S = 20.0  # send timeout, after which a page is gone
FAREWELL_S = 2.0  # for open pages to read the end of the flight
POLL_S = 1.0  # polling interval of mosaic.json without a feed
SMALL_BYTES = 1 << 20  # of a document that is answered from memory
CHUNK = 1 << 16  # bytes of a document in memory for each page that takes it
TILE_THREADS = 2  # for filling tiles; stitching has priority on the cores

FEED = web.AppKey("feed", Feed)
ANSWERED = web.AppKey("answered", AnsweredTiles)
TILE_POOL = web.AppKey("tile_pool", ThreadPoolExecutor)
PAGES = web.AppKey("pages", AddressQuota)
NAMES = web.AppKey("names", set[str])


def make_app(
    root: Path,
    address: HttpAddress,
    feed: Feed | None = None,
    access: Access | None = None,
    settings: WebSettings | None = None,
    hints: HintSettings | None = None,
) -> web.Application:
    """The application serving the output folder `root`; polls mosaic.json without a feed. Without `access`, for nobody else."""
    settings, access, names = settings or WebSettings(), access or Access(), set(own_names())
    checks = [host_check(address, names), origin_check, access_check(access), dates_check]
    app = web.Application(middlewares=[*checks, note_request])
    app[ROOT], app[FEED], app[NAMES] = root, feed or Feed(), names
    app[ACCESS], app[CHOOSING] = access, asyncio.Lock()
    app[ANSWERED] = AnsweredTiles(partial(last_revision, root))
    app[FEED].before_telling(app[ANSWERED].forget)
    app[PAGES] = AddressQuota(settings.pages, settings.pages_per_address)
    app[TILE_POOL] = ThreadPoolExecutor(TILE_THREADS, thread_name_prefix="web tiles")
    app.on_response_prepare.append(add_headers)
    app.on_shutdown.append(end_live)
    app.on_cleanup.append(end_tiles)
    if feed is None:
        app.cleanup_ctx.append(beside(poll_forever))
    if not address.is_loopback:
        app.cleanup_ctx.append(beside(learn_names))
    app.router.add_get("/", page)
    app.router.add_static("/viewer/", VIEWER, follow_symlinks=False, show_index=False)
    for name in DOCUMENTS:
        app.router.add_get(f"/{name}", document)
    app.router.add_get(f"/{STATUS}", status)
    app.router.add_get(f"/{JOURNAL_NAME}", journal)
    app.router.add_get("/sw.js", worker)
    app.router.add_get(TILE_PATH, tile)
    app.router.add_get("/live", live, allow_head=False)
    app.router.add_post(PATH, choose_vehicle)
    add_api(app, root, app[FEED], hints or HintSettings())
    add_maps(app, app[VIEW], app[FEED], settings, address)
    return app


@web.middleware
async def note_request(request: web.Request, handler: Handler) -> web.StreamResponse:
    """From now on the connection's deadline is that of an answer."""
    if isinstance(request.protocol, TimedRequestHandler):
        request.protocol.answering()
    return await handler(request)


async def page(_request: web.Request) -> web.StreamResponse:
    return web.FileResponse(VIEWER / "index.html")


async def worker(_request: web.Request) -> web.StreamResponse:
    """The page's service worker, which may answer for everything only if it lies at the root."""
    return web.FileResponse(VIEWER / "sw.js")


async def document(request: web.Request) -> web.StreamResponse:
    """One of the JSON documents, as on disk."""
    path = request.app[ROOT] / request.path.lstrip("/")
    try:
        small = await asyncio.to_thread(small_document, path)
    except OSError:
        raise web.HTTPNotFound(text=f"{path.name} is not written yet.\n") from None
    if small is None:
        return web.FileResponse(path, CHUNK, headers={"Content-Type": "application/json"})
    data, etag = small
    return tagged(request, data, "application/json", etag)


def small_document(path: Path) -> tuple[bytes, str] | None:
    """Content and entity tag of a document, None for a large one. A file that is sent while the connection is reset would stay
    open until it is collected. Raises OSError."""
    with inside.reading(path, path.parent) as file:
        found = os.fstat(file.fileno())
        if found.st_size > SMALL_BYTES:
            return None
        return file.read(), f"{found.st_mtime_ns:x}-{found.st_size:x}"


async def status(request: web.Request) -> web.StreamResponse:
    """status.json; other machines are not told where things lie on this one."""
    if is_local(request):
        return await document(request)
    try:
        data = await asyncio.to_thread(inside.read, request.app[ROOT] / STATUS, request.app[ROOT], LARGEST_DOCUMENT)
    except OSError:
        raise web.HTTPNotFound(text=f"{STATUS} is not written yet.\n") from None
    text = data.decode("utf-8", "replace")
    with suppress(ValueError, RecursionError):  # escapes would hide where a path ends
        text = json.dumps(json.loads(text), ensure_ascii=False)
    return web.Response(text=without_paths(text), content_type="application/json")


async def journal(request: web.Request) -> web.StreamResponse:
    """The placements journal: the lines of revisions after `?after=`."""
    path, after = request.app[ROOT] / JOURNAL_NAME, request.query.get("after", "0")
    if not REVISION.fullmatch(after):
        raise web.HTTPBadRequest(text="after= is to be a revision.\n")
    try:
        lines = await asyncio.to_thread(told_after, path, int(after))
    except (OSError, ValueError, LookupError, TypeError, RecursionError):  # there is none, or it is damaged
        raise web.HTTPNotFound(text="placements.json tells everything.\n") from None
    return web.Response(body=lines, content_type="application/x-ndjson")


async def tile(request: web.Request) -> web.StreamResponse:
    """One tile with its holes filled."""
    island, wanted = requested_tile(request)
    pool, kept = request.app[TILE_POOL], request.app[ANSWERED]
    make = partial(filled, request.app[ROOT], island, wanted)
    revision = request.query.get("r", "")
    least = int(revision) if REVISION.fullmatch(revision) else 0
    encoded = await asyncio.get_running_loop().run_in_executor(pool, kept.get, island, wanted, least, make)
    if encoded is None:
        return tile_answer(request, None)
    return tile_answer(request, encoded.data, encoded.media_type)


def requested_tile(request: web.Request) -> tuple[int, Tile]:
    """Island and tile of a request's path. Raises HTTPNotFound for a tile outside the grid."""
    island, z, x, y = (int(request.match_info[name]) for name in ("island", "z", "x", "y"))
    if z > FINEST_LEVEL or max(x, y) >= 1 << z:
        raise web.HTTPNotFound(text="There is no such tile.\n")
    return island, Tile(z, x, y)


async def live(request: web.Request) -> web.StreamResponse:
    """Server-sent events: the current revision first, then each change."""
    feed = request.app[FEED]
    with request.app[PAGES].taken(origin_of(request.remote)) as found:
        if not found:
            raise web.HTTPServiceUnavailable(text="Too many pages are open.\n")
        response = web.StreamResponse(headers={"Content-Type": "text/event-stream"})
        await response.prepare(request)
        if isinstance(request.protocol, TimedRequestHandler):
            request.protocol.streaming()
        with feed.subscribe() as subscription, suppress(ConnectionError, TimeoutError):
            await send(response, Change(last_revision(request.app[ROOT]), None))
            if feed.notes:
                await send(response, NotesChange(feed.notes))
            async for change in subscription.changes(HEARTBEAT_S):
                await send(response, change)
            await say_farewell(response)
    return response


async def send(response: web.StreamResponse, change: News | None) -> None:
    """Send one change, or a heartbeat. Raises TimeoutError and ConnectionError when the page is gone."""
    message = ": alive\n\n" if change is None else change.event
    async with asyncio.timeout(SEND_S):
        await response.write(message.encode())


async def say_farewell(response: web.StreamResponse) -> None:
    """Tell a page that the server ends, as opposed to a network that is lost. Raises as `send`."""
    async with asyncio.timeout(SEND_S):
        await response.write(b"event: ended\ndata: {}\n\n")


async def let_pages_read(app: web.Application) -> None:
    """Say farewell to the open pages, and leave them the time to read what was written last."""
    if app[FEED].subscribers:
        app[FEED].close()
        await asyncio.sleep(FAREWELL_S)


def beside(
    work: Callable[[web.Application], Coroutine[None, None, None]],
) -> Callable[[web.Application], AsyncIterator[None]]:
    """A task that runs as long as the application."""

    async def run(app: web.Application) -> AsyncIterator[None]:
        task = asyncio.create_task(work(app))
        yield
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task

    return run


async def poll_forever(app: web.Application) -> None:
    """Publish a revision whenever mosaic.json has changed."""
    root = app[ROOT]
    known = last_revision(root)
    while True:
        await asyncio.sleep(POLL_S)
        revision = await asyncio.to_thread(last_revision, root)
        if revision != known:
            known = revision
            app[FEED].publish(revision, None)


async def learn_names(app: web.Application) -> None:
    app[NAMES].update(await asyncio.to_thread(network_names))


async def end_live(app: web.Application) -> None:
    app[FEED].close()


async def end_tiles(app: web.Application) -> None:
    app[TILE_POOL].shutdown(wait=False, cancel_futures=True)
