"""A server of the page as long as a block lasts."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from gcs_mosaic.web.address import HttpAddress
from gcs_mosaic.web.feed import Feed
from gcs_mosaic.web.server import WebServer
from gcs_mosaic.web.settings import WebSettings


@contextmanager
def served(
    root: Path, *, port: int = 0, settings: WebSettings | None = None, feed: Feed | None = None
) -> Iterator[str]:
    """The page's URL on loopback, of a flight's folder; the server is stopped however the block ends."""
    server = WebServer(root, HttpAddress("127.0.0.1", port), feed, settings=settings)
    try:
        yield server.start()
    finally:
        server.stop()
