"""The process that serves the page of a live flight, started by page_keeper.

It is told of changes of the map, and tells whether the page can be served, then signs of life and log records. It ends when its
pipe is closed, which is when the flight has ended, however it has.
"""

from __future__ import annotations

import logging
from contextlib import suppress
from functools import partial
from multiprocessing.connection import Connection

from gcs_mosaic.errors import UsageError
from gcs_mosaic.processes.pipe import ChildTeller
from gcs_mosaic.web.page_task import PageTask
from gcs_mosaic.web.sparing_log import SparingHandler


def serve_page(pipe: Connection, task: PageTask) -> None:
    """Main function of the process."""
    from gcs_mosaic.web.feed import Feed
    from gcs_mosaic.web.server import WebServer  # loads a server, which is not for the flight

    teller = ChildTeller(pipe)
    logging.basicConfig(level=logging.INFO, handlers=[SparingHandler(teller.log)])
    logging.captureWarnings(True)
    feed = Feed()
    alive = partial(teller.tell, alive=True)
    server = WebServer(task.root, task.address, feed, task.access, task.settings, pulse=alive, hints=task.hints)
    try:
        server.start()
    except (UsageError, TimeoutError) as error:
        teller.tell(refused=str(error) or "the page could not be started in time")
        return
    teller.tell(listening=server.port)
    with suppress(EOFError, OSError):
        while True:
            feed.pass_on(pipe.recv())
    server.stop()
