"""What is new, as it happens."""

from __future__ import annotations

import asyncio
from contextlib import suppress

from aiohttp import web

from gcs_mosaic.store.revision import last_revision
from gcs_mosaic.web.address_quota import AddressQuota, origin_of
from gcs_mosaic.web.api.operations import JsonLines, Operations, Reply
from gcs_mosaic.web.change import Alive, Change, ChangeEntry, Farewell, NotesChange
from gcs_mosaic.web.choosing import ROOT
from gcs_mosaic.web.feed import Feed, News
from gcs_mosaic.web.request_handler import TimedRequestHandler

HEARTBEAT_S = (
    2.0  # tells a page that answers late from one that is lost; keeps NAT entries alive, detects pages that are gone
)
SEND_S = 20.0  # send timeout, after which a page is gone

FEED = web.AppKey("feed", Feed)
PAGES = web.AppKey("pages", AddressQuota)

OPERATIONS = Operations()


@OPERATIONS.add(
    "GET",
    "/live",
    Reply(
        "Messages, and events `notes`, `alive` and `ended`.",
        JsonLines(("text/event-stream",), (ChangeEntry, NotesChange, Alive, Farewell)),
    ),
    failures={503: "Too many pages are open."},
)
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
    """Send one change, or a sign of life. Raises TimeoutError and ConnectionError when the page is gone."""
    message = (change or Alive()).event
    async with asyncio.timeout(SEND_S):
        await response.write(message.encode())


async def say_farewell(response: web.StreamResponse) -> None:
    """Tell a page that the server ends, as opposed to a network that is lost. Raises as `send`."""
    async with asyncio.timeout(SEND_S):
        await response.write(Farewell().event.encode())
