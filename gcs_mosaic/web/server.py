"""The page's HTTP server, on its own thread."""

from __future__ import annotations

import asyncio
import errno
import logging
import ssl
import threading
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

from aiohttp import web

from gcs_mosaic.errors import UsageError
from gcs_mosaic.hints.settings import HintSettings
from gcs_mosaic.web.address import DEFAULT, HttpAddress
from gcs_mosaic.web.app import let_pages_read, make_app
from gcs_mosaic.web.feed import Feed
from gcs_mosaic.web.listener import PageListener, listening
from gcs_mosaic.web.settings import WebSettings
from gcs_mosaic.web.token import Access

logger = logging.getLogger(__name__)

START_S = 10.0  # timeout until the socket listens
STOP_S = 5.0  # grace period for open requests
PULSE_S = 5.0
PORTS_TRIED, HIGHEST_PORT = 100, 65535  # for one to propose


class WebServer:
    """Serves an output folder until `stop`. With a feed, pages are updated at once; `pulse` is called as long as it answers."""

    def __init__(
        self,
        root: Path,
        address: HttpAddress,
        feed: Feed | None = None,
        access: Access | None = None,
        settings: WebSettings | None = None,
        pulse: Callable[[], None] | None = None,
        hints: HintSettings | None = None,
    ) -> None:
        self._address, self._settings, self._pulse = address, settings or WebSettings(), pulse
        self._make_app = partial(make_app, root, address, feed, access, self._settings, hints)
        self._thread = threading.Thread(target=self._run, name="web", daemon=True)
        self._started: Future[int] = Future()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._end: asyncio.Event | None = None

    def start(self) -> str:
        """Start serving and return the page's URL. Raises UsageError if that cannot be."""
        self._thread.start()
        return self._address.url(self._started.result(START_S), secure=self._settings.certificate is not None)

    @property
    def port(self) -> int:
        """The port that is listened on, once started."""
        return self._started.result(START_S)

    def stop(self) -> None:
        """Stop the server and close all connections; idempotent."""
        if self._loop is None or self._end is None or not self._thread.is_alive():
            return
        with suppress(RuntimeError):  # it has just ended
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
        self._loop.set_exception_handler(_log)
        tls = tls_of(self._settings)
        app = self._make_app()
        runner = web.AppRunner(app, access_log=None, shutdown_timeout=STOP_S, handler_cancellation=True)
        await runner.setup()
        assert runner.server is not None, "it has been set up"
        listener = PageListener(runner.server, self._settings, tls)
        try:
            self._started.set_result(await self._open(listener))
            await self._until_end(self._end, listener)
            await let_pages_read(app)
        finally:
            await listener.close()
            await runner.cleanup()

    async def _open(self, listener: PageListener) -> int:
        """Bind the address and return the port."""
        try:
            return await listener.open(self._address.host, self._address.port)
        except (OSError, OverflowError) as error:
            raise UsageError(cannot_listen(self._address, error)) from error

    async def _until_end(self, end: asyncio.Event, listener: PageListener) -> None:
        while not end.is_set():
            if self._pulse is not None and listener.is_open:
                self._pulse()
            with suppress(TimeoutError):
                async with asyncio.timeout(PULSE_S):
                    await end.wait()


def tls_of(settings: WebSettings) -> ssl.SSLContext | None:
    """What HTTPS needs, if there is a certificate. Raises UsageError."""
    if settings.certificate is None:
        return None
    context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
    key = settings.key or settings.certificate
    try:
        context.load_cert_chain(settings.certificate, key, password="")  # of a locked key nobody is asked
    except (OSError, ValueError) as error:
        why = error.strerror if isinstance(error, FileNotFoundError | PermissionError) else error
        raise UsageError(
            f"web: the certificate {settings.certificate} and key {key} cannot be used ({why}): name PEM files of a certificate "
            "and its private key, which has no passphrase"
        ) from error
    return context


def _log(_loop: asyncio.AbstractEventLoop, what: dict[str, Any]) -> None:
    """What a connection has thrown: a line, whereas asyncio's own handler prints its whole state."""
    error = what.get("exception")
    outside = isinstance(error, OSError) or error is None
    logger.warning("%s (%r)", what.get("message"), error, exc_info=None if outside else error)


def _free_beside(address: HttpAddress) -> str:
    """The next address on which nothing listens now; port 0, with which the system chooses one, if there is none nearby."""
    host = f"[{address.host}]" if ":" in address.host else address.host
    for port in range(address.port + 1, min(address.port + PORTS_TRIED, HIGHEST_PORT) + 1):
        try:
            for one in listening(address.host, port):
                one.close()
        except OSError:
            logger.debug("port %d is no better", port, exc_info=True)
        else:
            return f"{host}:{port}"
    return f"{host}:0"


def cannot_listen(address: HttpAddress, error: Exception) -> str:
    """The error message for the operator."""
    text = f"{address.host}:{address.port}"
    match getattr(error, "errno", None):
        case errno.EADDRINUSE:
            return f"another program listens on {text} already: choose --http {_free_beside(address)}, or --no-http for no page"
        case errno.EADDRNOTAVAIL:
            return f"{text} is not an address of this machine: choose --http {DEFAULT}, or --no-http for no page"
        case errno.EACCES:
            return f"{text} needs administrator rights: choose --http {DEFAULT}, or --no-http for no page"
    return f"the page cannot be served on {text} ({error}): choose --http {DEFAULT}, or --no-http for no page"
