"""The process that serves the page of a live flight: `python -m gcs_mosaic.web.page_process`, started by page_keeper.

It is told on standard input, and tells on standard output, in lines of JSON: first what to serve (PageTask) and whether that can
be, then changes of the map in, signs of life and log records out. It ends when its standard input does, which is when the flight
has ended, however it has.
"""

from __future__ import annotations

import json
import logging
import os
import sys
import threading
from collections.abc import Iterator
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import BinaryIO

from gcs_mosaic.children import outlive_signals
from gcs_mosaic.errors import UsageError
from gcs_mosaic.web.change import Change
from gcs_mosaic.web.feed import Feed
from gcs_mosaic.web.page_task import PageTask
from gcs_mosaic.web.server import WebServer
from gcs_mosaic.web.sparing_log import SparingHandler

AUTOGROUP = Path("/proc/self/autogroup")
NICENESS = 10  # of 19: the flight comes first


def main() -> None:
    """Serve until standard input ends."""
    _begin_as_child()
    tell = _Teller()
    _log_to(tell)
    lines = whole_lines(sys.stdin.buffer)
    task = PageTask.read(json.loads(next(lines, None) or sys.exit()))
    feed = Feed()
    alive = partial(tell, alive=True)
    server = WebServer(task.root, task.address, feed, task.access, task.settings, pulse=alive, hints=task.hints)
    try:
        server.start()
    except (UsageError, TimeoutError) as error:
        tell(refused=str(error) or "the page could not be started in time")
        return
    tell(listening=server.port)
    for line in lines:
        feed.pass_on(Change.read(json.loads(line)))
    server.stop()


def whole_lines(source: BinaryIO) -> Iterator[bytes]:
    """Until the end; a flight that is killed may leave part of one."""
    for line in source:
        if line.endswith(b"\n"):
            yield line


def _begin_as_child() -> None:
    outlive_signals()
    if hasattr(os, "nice"):  # not on Windows
        os.nice(NICENESS)
    # Where Linux shares the processor among sessions first (sched_autogroup_enabled), and only then by niceness.
    with suppress(OSError):
        AUTOGROUP.write_text(str(NICENESS))


def _log_to(tell: _Teller) -> None:
    logging.basicConfig(level=logging.INFO, handlers=[SparingHandler(lambda text, level: tell(log=[level, text]))])
    logging.captureWarnings(True)


class _Teller:
    """Writes a line to standard output; the other end may be gone, which standard input tells."""

    def __init__(self) -> None:
        self._lock = threading.Lock()

    def __call__(self, **told: object) -> None:
        try:
            with self._lock:
                os.write(sys.stdout.fileno(), f"{json.dumps(told)}\n".encode())
        except OSError:
            return


if __name__ == "__main__":
    main()
