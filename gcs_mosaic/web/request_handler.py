"""One connection to the page, with a deadline for whatever its peer is to do next."""

from __future__ import annotations

import asyncio
import logging
from typing import Any

from aiohttp import web
from aiohttp.http import HttpProcessingError

from gcs_mosaic.web.guard import HEADERS
from gcs_mosaic.web.settings import WebSettings
from gcs_mosaic.web.token import without_token

logger = logging.getLogger(__name__)

TICK_S = 0.5  # between looks at the deadline
SHOWN = 200  # characters of what a peer sent


class TimedRequestHandler(web.RequestHandler):
    """aiohttp's protocol for a connection, which waits for ever for a request, and for an answer to be taken.

    Here a request must have come as a whole within `request_s` of the last answer, or the connection's begin, and its answer
    must be taken within `answer_s`, or the connection is cut. The stream of changes has time-outs of its own.
    """

    def __init__(self, server: web.Server, settings: WebSettings) -> None:
        loop = asyncio.get_running_loop()
        super().__init__(server, loop=loop, access_log=None, logger=logger, keepalive_timeout=settings.request_s)  # type: ignore[arg-type]
        self._settings = settings
        self._clock = loop.time
        self._gone: asyncio.Future[None] = loop.create_future()
        self._line: asyncio.BaseTransport | None = None
        self._deadline: float | None = None
        self.is_waiting = True  # for a request

    async def until_gone(self) -> None:
        """Wait for the connection's end, and cut it at its deadline."""
        while not self._gone.done():
            await asyncio.wait([self._gone], timeout=TICK_S)
            if self._deadline is not None and self._clock() > self._deadline:
                self.cut()

    def cut(self) -> None:
        """End the connection at once, whatever is still to be sent."""
        if isinstance(self._line, asyncio.Transport):
            self._line.abort()

    def answering(self) -> None:
        """A request has come as a whole."""
        self.is_waiting = False
        self._deadline = self._clock() + self._settings.answer_s

    def streaming(self) -> None:
        """The answer goes on for as long as its handler says."""
        self._deadline = None

    def _waiting(self) -> None:
        self.is_waiting = True
        self._deadline = self._clock() + self._settings.request_s

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._line = transport
        self._waiting()
        super().connection_made(transport)

    def connection_lost(self, exc: BaseException | None) -> None:
        super().connection_lost(exc)
        if not self._gone.done():
            self._gone.set_result(None)

    async def finish_response(
        self, request: web.BaseRequest, resp: web.StreamResponse, start_time: Any
    ) -> tuple[web.StreamResponse, bool]:
        try:
            if self._deadline is None:
                self.answering()
            return await super().finish_response(request, resp, start_time)
        finally:
            self._waiting()

    def handle_error(
        self,
        request: web.BaseRequest,
        status: int = 500,
        exc: BaseException | None = None,
        message: str | None = None,
    ) -> web.StreamResponse:
        response = super().handle_error(request, status, exc, message)
        response.headers.update(HEADERS)  # no signal is sent for a request that cannot be read
        return response

    def log_exception(self, *args: Any, **more: Any) -> None:
        """What a peer got wrong is no fault of ours: one line, without a traceback."""
        error = more.get("exc_info")
        if isinstance(error, HttpProcessingError):
            said = without_token(" ".join(str(error.message).split()))
            logger.warning("a request cannot be read: %.*s", SHOWN, said)
        else:
            super().log_exception(*args, **more)
