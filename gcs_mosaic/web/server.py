"""The page's HTTP server, on its own thread."""

from __future__ import annotations

import asyncio
import errno
import threading
from concurrent.futures import Future
from dataclasses import dataclass
from pathlib import Path

from aiohttp import web

from gcs_mosaic.errors import UsageError
from gcs_mosaic.web.address import DEFAULT, HttpAddress
from gcs_mosaic.web.app import make_app
from gcs_mosaic.web.feed import Feed

START_S = 10.0  # timeout until the socket listens
STOP_S = 5.0  # grace period for open requests


@dataclass(frozen=True, slots=True, kw_only=True)
class WebSettings:
    """Settings of the page."""

    # HOST:PORT; "" for no page. Loopback, because the page needs no password; 0.0.0.0:8470 serves it to a tablet on the
    # same network.
    address: str = DEFAULT


class WebServer:
    """Serves an output folder until `stop`. With a feed, pages are updated at once."""

    def __init__(self, root: Path, address: HttpAddress, feed: Feed | None = None) -> None:
        self._root, self._address, self._feed = root, address, feed
        self._thread = threading.Thread(target=self._run, name="web", daemon=True)
        self._started: Future[str] = Future()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._end: asyncio.Event | None = None

    def start(self) -> str:
        """Start serving and return the page's URL. Raises UsageError if the address cannot be bound."""
        self._thread.start()
        return self._started.result(START_S)

    def stop(self) -> None:
        """Stop the server and close all connections; idempotent."""
        if self._loop is None or self._end is None or not self._thread.is_alive():
            return
        self._loop.call_soon_threadsafe(self._end.set)
        self._thread.join(2 * STOP_S)

    def _run(self) -> None:
        try:
            asyncio.run(self._serve())
        except Exception as error:
            if self._started.done():
                raise
            self._started.set_exception(error)

    async def _serve(self) -> None:
        self._loop, self._end = asyncio.get_running_loop(), asyncio.Event()
        app = make_app(self._root, self._address, self._feed)
        runner = web.AppRunner(app, access_log=None, shutdown_timeout=STOP_S)
        await runner.setup()
        try:
            self._started.set_result(self._address.url(await self._listen(runner)))
            await self._end.wait()
        finally:
            await runner.cleanup()

    async def _listen(self, runner: web.AppRunner) -> int:
        """Bind the address and return the port."""
        try:
            await web.TCPSite(runner, self._address.host, self._address.port).start()
        except (OSError, OverflowError) as error:
            raise UsageError(cannot_listen(self._address, error)) from error
        return int(runner.addresses[0][1])


def cannot_listen(address: HttpAddress, error: Exception) -> str:
    """The error message for the operator."""
    text = f"{address.host}:{address.port}"
    match getattr(error, "errno", None):
        case errno.EADDRINUSE:
            other = f"{address.host}:{address.port + 1}"
            return f"another program listens on {text} already: choose --http {other}, or --no-http for no page"
        case errno.EADDRNOTAVAIL:
            return f"{text} is not an address of this machine: choose --http {DEFAULT}, or --no-http for no page"
        case errno.EACCES:
            return f"{text} needs administrator rights: choose --http {DEFAULT}, or --no-http for no page"
    return f"the page cannot be served on {text} ({error}): choose --http {DEFAULT}, or --no-http for no page"
