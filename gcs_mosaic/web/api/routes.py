"""All of the API's routes."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from aiohttp import web

from gcs_mosaic.views.flight_view import FlightView
from gcs_mosaic.web.api import flight, frames, layers
from gcs_mosaic.web.api.common import POOL, THREADS, VIEW

ROOMS = (flight, frames, layers)  # modules with `add_routes`


def add_api(app: web.Application, root: Path) -> None:
    """Answer questions about the flight in a folder."""
    app[VIEW] = FlightView(root)
    app[POOL] = ThreadPoolExecutor(THREADS, thread_name_prefix="api")
    app.on_cleanup.append(_end)
    for room in ROOMS:
        room.add_routes(app)


async def _end(app: web.Application) -> None:
    app[POOL].shutdown(wait=False, cancel_futures=True)
