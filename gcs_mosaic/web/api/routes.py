"""All of the API's routes."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from aiohttp import web

from gcs_mosaic.hints.settings import HintSettings
from gcs_mosaic.views.flight_view import FlightView
from gcs_mosaic.web import documents, live, tiles
from gcs_mosaic.web.api import (
    anchors,
    detection,
    finds,
    flight,
    flying,
    frames,
    ground,
    handed_over,
    hints,
    hints_dismissed,
    integral,
    layers,
    looking,
    looks,
    maps,
    movers,
    reviews,
    scale,
)
from gcs_mosaic.web.api.common import POOL, SLOW_POOL, THREADS, VIEW
from gcs_mosaic.web.api.notes import add_notes
from gcs_mosaic.web.api.operations import add_operations
from gcs_mosaic.web.feed import Feed

ROOMS = (
    flight,
    frames,
    looks,
    layers,
    detection,
    finds,
    scale,
    reviews,
    looking,
    hints,
    hints_dismissed,
    integral,
    ground,
    movers,
    anchors,
    maps,
    handed_over,
    flying,
    documents,
    tiles,
    live,
)  # modules with OPERATIONS


def add_api(app: web.Application, root: Path, feed: Feed, settings: HintSettings) -> None:
    """Answer questions about the flight in a folder."""
    app[VIEW] = FlightView(root)
    app[POOL] = ThreadPoolExecutor(THREADS, thread_name_prefix="api")
    app[SLOW_POOL] = ThreadPoolExecutor(THREADS, thread_name_prefix="api slow")
    app.on_cleanup.append(_end)
    add_notes(app, app[VIEW], feed)
    hints.add_hints(app, settings)
    layers.keep_tiles(app)
    detection.add_detection(app)
    integral.add_lenses(app)
    ground.add_ground(app)
    frames.keep_pieces(app)
    movers.keep_search(app)
    handed_over.add_sending(app)
    for room in ROOMS:
        add_operations(app, room.OPERATIONS)


async def _end(app: web.Application) -> None:
    for pool in (POOL, SLOW_POOL):
        app[pool].shutdown(wait=False, cancel_futures=True)
