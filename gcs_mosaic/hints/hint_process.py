"""The process that seeks hints: `python -m gcs_mosaic.hints.hint_process`, started by whoever serves the page.

It is told on standard input, in lines of JSON: first the flight's folder and the settings, then the colours that are sought, each
time that they change. On standard output it tells `ready`, or why it `refused`, in JSON, and what is logged as plain text. It
ends when its standard input does, whoever has ended that.
"""

from __future__ import annotations

import json
import logging
import os
import sys
import threading
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from gcs_mosaic.children import outlive_signals
from gcs_mosaic.errors import UsageError
from gcs_mosaic.hints.seeker import Seeker
from gcs_mosaic.hints.settings import HintSettings
from gcs_mosaic.hints.sought import SoughtColour

try:
    import resource
except ImportError:  # Windows
    resource = None  # type: ignore[assignment]

NICENESS = 15  # of 19: the flight and its page come first
REST_S = 1.0  # until the next look whether there is a new frame
BESIDE = 0.25  # rest after each frame, of the time that it took: the aircraft's machine has other work
MOST_BYTES = 4 << 30  # of address space, of which libraries and threads take one


def main() -> None:
    """Seek until standard input ends."""
    _begin_as_child()
    logging.basicConfig(level=logging.WARNING, stream=sys.stdout)
    lines = iter(sys.stdin)
    task = json.loads(next(lines, None) or sys.exit())
    if task["settings"].get("model"):
        _limit_memory()
    try:
        seeker = Seeker(Path(task["root"]), HintSettings(**task["settings"]))
    except UsageError as error:
        _tell(refused=str(error))
        return
    _tell(ready=True)
    wanted = Wanted()
    threading.Thread(target=wanted.hear, args=(lines,), name="wanted", daemon=True).start()
    try:
        seek(seeker, wanted)
    except UsageError as error:  # a detector whose output is not understood; a ledger that cannot be read now
        _tell(refused=str(error))
    finally:
        seeker.close()


class Wanted:
    """The colours that are sought now, and whether anything is."""

    def __init__(self) -> None:
        self.colours: Sequence[SoughtColour] = ()
        self.changed = threading.Event()
        self.over = False

    def hear(self, lines: Iterable[str]) -> None:
        """Take in what is told, until the end."""
        for line in lines:
            self.colours = colours_of(json.loads(line))
            self.changed.set()
        self.over = True
        self.changed.set()


def seek(seeker: Seeker, wanted: Wanted) -> None:
    """Search frame after frame until it is over."""
    while not wanted.over:
        found, took = seeker.timed_step(wanted.colours)
        wanted.changed.wait(REST_S if found is None else BESIDE * took)
        wanted.changed.clear()


def colours_of(told: dict[str, Any]) -> Sequence[SoughtColour]:
    return [
        SoughtColour(number=one["number"], bgr=tuple(one["bgr"]), tolerance=one["tolerance"]) for one in told["colours"]
    ]


def _tell(**told: object) -> None:
    print(json.dumps(told), flush=True)


def _begin_as_child() -> None:
    outlive_signals()
    if hasattr(os, "nice"):  # not on Windows
        os.nice(NICENESS)


def _limit_memory() -> None:
    """What a model asks for beyond that fails in here, and takes nothing from the flight; where systems can."""
    if resource is None:
        return
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    if soft == resource.RLIM_INFINITY:
        resource.setrlimit(resource.RLIMIT_AS, (MOST_BYTES, hard))


if __name__ == "__main__":
    main()
