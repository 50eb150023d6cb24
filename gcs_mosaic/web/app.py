"""The page's HTTP application: a flight's output folder, read-only but for the choice of an aircraft
(`choosing`) and for notes (`api/notes`), which are no part of the flight.

Runs beside a live flight, which passes it a Feed, or on its own, polling mosaic.json.
"""

from __future__ import annotations

import asyncio
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

from aiohttp import web
from aiohttp.typedefs import Handler

from gcs_mosaic.hints.settings import HintSettings
from gcs_mosaic.store.revision import last_revision
from gcs_mosaic.web.access import access_check
from gcs_mosaic.web.address import HttpAddress, network_names, own_names
from gcs_mosaic.web.address_quota import AddressQuota
from gcs_mosaic.web.answered_tiles import AnsweredTiles
from gcs_mosaic.web.api.common import VIEW, beside
from gcs_mosaic.web.api.finds import COT
from gcs_mosaic.web.api.routes import add_api
from gcs_mosaic.web.bundle import NAME, bundle
from gcs_mosaic.web.choosing import ACCESS, CHOOSING, PATH, ROOT, choose_vehicle
from gcs_mosaic.web.feed import Feed
from gcs_mosaic.web.guard import add_headers, dates_check, host_check, origin_check
from gcs_mosaic.web.live import FEED, PAGES
from gcs_mosaic.web.maps.routes import add_maps
from gcs_mosaic.web.request_handler import TimedRequestHandler
from gcs_mosaic.web.settings import WebSettings
from gcs_mosaic.web.tile_answer import tagged
from gcs_mosaic.web.tiles import ANSWERED, TILE_POOL
from gcs_mosaic.web.token import Access

VIEWER = Path(__file__).parent / "viewer"
FAREWELL_S = 2.0  # for open pages to read the end of the flight
POLL_S = 1.0  # polling interval of mosaic.json without a feed
TILE_THREADS = 2  # for filling tiles; stitching has priority on the cores

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
    app[COT] = settings.cot or ""
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
    app.router.add_get(f"/viewer/{NAME}", scripts)
    app.router.add_static("/viewer/", VIEWER, follow_symlinks=False, show_index=False)
    app.router.add_get("/sw.js", worker)
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


async def scripts(request: web.Request) -> web.StreamResponse:
    """All of the page's scripts."""
    return tagged(request, bundle(VIEWER).encode(), "text/javascript", charset="utf-8")


async def worker(_request: web.Request) -> web.StreamResponse:
    """The page's service worker, which may answer for everything only if it lies at the root."""
    return web.FileResponse(VIEWER / "sw.js")


async def let_pages_read(app: web.Application) -> None:
    """Say farewell to the open pages, and leave them the time to read what was written last."""
    if app[FEED].subscribers:
        app[FEED].close()
        await asyncio.sleep(FAREWELL_S)


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
