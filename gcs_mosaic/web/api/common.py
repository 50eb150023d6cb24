"""What handlers of the API share: the flight they answer about, threads to work on, checked parameters, answers."""

from __future__ import annotations

import asyncio
import json
import logging
from collections.abc import AsyncIterator, Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from typing import Annotated, Any, TypeVar

from aiohttp import web

from gcs_mosaic.store.documents import Limits, told_of
from gcs_mosaic.views.flight_view import FlightView
from gcs_mosaic.web.tile_answer import tagged

logger = logging.getLogger(__name__)

BASE = "/api/v1"
MapRevision = Annotated[int, Limits(least=0), "of the map: the answer is as new as this one, or newer"]
# Of a question: the page tells the newest that it knows, so that no answer is older than what it shows.
AskedRevision = Annotated[int, Limits(least=0, most=1 << 53), "of the map: the answer is to be as new, if the map is"]
THREADS = 2  # for questions; stitching has priority on the cores
# A frame is in the ledger before its tiles are written and told of: for so long it may not be on anybody's screen.
SHOWN_S = 5.0
TOO_MANY = "Too many ask for this at once: ask again in a moment."
LARGEST_BODY = 1 << 16  # bytes

VIEW = web.AppKey("view", FlightView)
POOL = web.AppKey("pool", ThreadPoolExecutor)
# What decodes originals, or paints, has threads of its own, so that quick questions do not wait behind it.
SLOW_POOL = web.AppKey("slow_pool", ThreadPoolExecutor)

Result = TypeVar("Result")


async def in_thread(
    request: web.Request,
    work: Callable[..., Result],
    *given: Any,
    pool: web.AppKey[ThreadPoolExecutor] = POOL,
) -> Result:
    """Run blocking work on a thread of the API's own."""
    return await asyncio.get_running_loop().run_in_executor(request.app[pool], work, *given)


class OneThread:
    """A thread for one kind of work that takes long; who comes while `most` wait is told so (`busy`), instead of waiting ever
    longer. `finishes`: what was asked for is done, also for somebody who does not wait for it."""

    def __init__(self, name: str, most: int, busy: str = TOO_MANY, *, finishes: bool = False) -> None:
        self._pool = ThreadPoolExecutor(1, thread_name_prefix=name)
        self._most, self._busy, self._finishes = most, busy, finishes
        self._waiting = 0

    async def run(self, work: Callable[..., Result], *given: Any) -> Result:
        """For a question. Raises HTTPServiceUnavailable."""
        if self._waiting >= self._most:
            raise web.HTTPServiceUnavailable(text=f"{self._busy}\n")
        self._waiting += 1
        try:
            doing = asyncio.ensure_future(self.run_anyway(work, *given))
            return await (asyncio.shield(doing) if self._finishes else doing)
        finally:
            self._waiting -= 1

    async def run_anyway(self, work: Callable[..., Result], *given: Any) -> Result:
        """For what nobody asks for."""
        return await asyncio.get_running_loop().run_in_executor(self._pool, work, *given)

    def end(self) -> None:
        self._pool.shutdown(wait=False, cancel_futures=True)


Work = Callable[[web.Application], Awaitable[None]]


def beside(work: Work, end: Work | None = None) -> Callable[[web.Application], AsyncIterator[None]]:
    """A task that runs as long as the application, and what is done when it has ended."""

    async def run(app: web.Application) -> AsyncIterator[None]:
        task = asyncio.ensure_future(work(app))
        yield
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task
        if end is not None:
            await end(app)

    return run


async def steadily(step: Callable[[], Awaitable[bool]], pause_s: float) -> None:
    """Do a step after the other, with a pause after one that tells False; one that fails does not end those that follow."""
    while True:
        try:
            if await step():
                continue
        except Exception:
            logger.exception("a step failed, the next one follows")
        await asyncio.sleep(pause_s)


async def map_revision(request: web.Request, at_least: int = 0) -> int:
    """Of the frames as they are known now; to be asked before an answer is made of them."""
    return (await in_thread(request, request.app[VIEW].table, at_least)).revision


def bad(text: str) -> web.HTTPBadRequest:
    return web.HTTPBadRequest(text=f"{text}\n")


def missing(text: str) -> web.HTTPNotFound:
    return web.HTTPNotFound(text=f"{text}\n")


async def body_of(request: web.Request) -> dict[str, Any]:
    """The JSON object that was sent. Raises HTTPBadRequest, HTTPRequestEntityTooLarge and HTTPUnsupportedMediaType."""
    if (request.content_length or 0) > LARGEST_BODY:
        raise web.HTTPRequestEntityTooLarge(LARGEST_BODY, request.content_length or 0)
    try:
        data = await request.read()
        if len(data) > LARGEST_BODY:  # of an unknown length, or unpacked
            raise web.HTTPRequestEntityTooLarge(LARGEST_BODY, len(data))
        told = json.loads(data.decode(request.charset or "utf-8"))
    except web.RequestPayloadError as error:
        raise bad("The body cannot be unpacked as its Content-Encoding says: send it as it is.") from error
    except LookupError as error:
        raise web.HTTPUnsupportedMediaType(text="The charset is not known: send the JSON as UTF-8.\n") from error
    except (ValueError, RecursionError) as error:
        raise bad("A JSON object is to be sent.") from error
    if not isinstance(told, dict):
        raise bad("A JSON object is to be sent.")
    return told


def answer(document: Any, status: int = 200, **headers: str) -> web.Response:
    """A JSON answer; `document` may hold dataclasses."""
    return web.Response(text=text_of_json(document), status=status, content_type="application/json", headers=headers)


def told_anew(request: web.Request, document: Any) -> web.Response:
    """A JSON answer with an ETag; 304 to whom knows it."""
    return tagged(request, text_of_json(document).encode(), "application/json")


def text_of_json(document: Any) -> str:
    return json.dumps(document, separators=(",", ":"), allow_nan=False, default=told_of)
