"""`gcs-mosaic serve`: the page of a flight that somebody else writes, or that has ended."""

from __future__ import annotations

import logging
import sys
import threading
from pathlib import Path

from gcs_mosaic.hints.settings import HintSettings
from gcs_mosaic.web.address import HttpAddress
from gcs_mosaic.web.invitation import invitation, scannable
from gcs_mosaic.web.server import WebServer
from gcs_mosaic.web.settings import WebSettings
from gcs_mosaic.web.sparing_log import SparingHandler
from gcs_mosaic.web.token import access_to


def serve_until(stop: threading.Event, flight: Path, http: str, settings: WebSettings, hints: HintSettings) -> None:
    """Serve until `stop` is set, and say where. Raises UsageError."""
    logging.basicConfig(level=logging.WARNING, handlers=[SparingHandler(_warn)])
    address = HttpAddress.parse(http)
    access = access_to(address, settings, flight)
    server = WebServer(flight, address, access=access, settings=settings, hints=hints)
    print(f"the map is at {server.start()} (Ctrl-C ends)", flush=True)
    invited = invitation(address, server.port, access, secure=settings.certificate is not None)
    if invited is not None:
        print(invited.notice, *invited.links, sep="\n", flush=True)
        if invited.links and (sys.stdout.isatty() if settings.qr == "auto" else settings.qr == "always"):
            print(scannable(invited.links[0]), flush=True)
    while not stop.wait(1.0):
        pass
    server.stop()


def _warn(text: str, _level: int) -> None:
    print(f"gcs-mosaic: {text.splitlines()[0]}", file=sys.stderr, flush=True)
