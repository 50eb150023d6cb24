"""Choosing, on the page, the aircraft that a running flight follows: all that the page can change of a flight."""

from __future__ import annotations

import asyncio
import logging
from pathlib import Path

from aiohttp import web

from gcs_mosaic.store.disk import DiskFull
from gcs_mosaic.store.requests import ask_to_follow
from gcs_mosaic.web.access import is_local
from gcs_mosaic.web.token import Access

PATH = r"/vehicle/{system:[0-9]{1,3}}"
ANSWER_S = 8.0  # for the flight to answer: it looks once a second, and between two frames only
SYSTEMS = range(1, 256)

logger = logging.getLogger(__name__)

ROOT = web.AppKey("root", Path)
ACCESS = web.AppKey("access", Access)
CHOOSING = web.AppKey("choosing", asyncio.Lock)


async def choose_vehicle(request: web.Request) -> web.StreamResponse:
    """POST: have the flight in this folder follow an aircraft; answers in one sentence.

    Where everybody may look (`web: {open: true}`), only this machine may choose.
    """
    if request.app[ACCESS].is_open and not is_local(request):
        raise web.HTTPForbidden(text="The aircraft is chosen on the machine that runs gcs-mosaic.\n")
    system = int(request.match_info["system"])
    if system not in SYSTEMS:
        raise web.HTTPNotFound(text="MAVLink system ids are from 1 to 255.\n")
    try:
        async with request.app[CHOOSING]:  # one at a time: a later request would take the place of one that waits
            answer = await asyncio.to_thread(ask_to_follow, request.app[ROOT], system, ANSWER_S)
    except (OSError, DiskFull) as error:
        logger.warning("a request for system %d cannot be written", system, exc_info=True)
        raise web.HTTPServiceUnavailable(text="The flight's folder cannot be written now.\n") from error
    if answer is None:
        raise web.HTTPGatewayTimeout(text="The flight does not answer, so nothing was changed.\n")
    status = 200 if answer.taken else 409
    return web.Response(status=status, text=f"{answer.text}\n")
