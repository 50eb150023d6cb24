"""The process that seeks hints, started by whoever serves the page.

It is told of the colours that are sought, each time that they change. It tells that it is `ready`, or why it has `refused`, and
what is logged. It ends when its pipe is closed, whoever has ended that.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Sequence
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING

from gcs_mosaic.errors import UsageError
from gcs_mosaic.hints.settings import HintSettings
from gcs_mosaic.hints.sought import SoughtColour
from gcs_mosaic.processes.limits import limit_memory
from gcs_mosaic.processes.pipe import ChildTeller, TellingHandler

if TYPE_CHECKING:
    from gcs_mosaic.hints.seeker import Seeker

REST_S = 1.0  # until the next look whether there is a new frame
BESIDE = 0.25  # rest after each frame, of the time that it took: the aircraft's machine has other work
MOST_BYTES = 3 << 30  # of address space for a model, beside the libraries'


def seek_hints(pipe: Connection, root: Path, settings: HintSettings) -> None:
    """Main function of the process."""
    from gcs_mosaic.hints.seeker import Seeker  # loads what searches, which is not for the page

    teller = ChildTeller(pipe)
    logging.basicConfig(level=logging.WARNING, handlers=[TellingHandler(teller)])
    if settings.model:
        limit_memory(MOST_BYTES)  # what a model asks for beyond that fails in here, and takes nothing from the flight
    try:
        seeker = Seeker(root, settings)
    except UsageError as error:
        teller.tell(refused=str(error))
        return
    teller.tell(ready=True)
    wanted = Wanted()
    threading.Thread(target=wanted.hear, args=(pipe,), name="wanted", daemon=True).start()
    try:
        seek(seeker, wanted)
    except UsageError as error:  # a detector whose output is not understood; a ledger that cannot be read now
        teller.tell(refused=str(error))
    finally:
        seeker.close()


class Wanted:
    """The colours that are sought now, and whether anything is."""

    def __init__(self) -> None:
        self.colours: Sequence[SoughtColour] = ()
        self.changed = threading.Event()
        self.over = False

    def hear(self, pipe: Connection) -> None:
        """Take in what is told, until the end."""
        with suppress(EOFError, OSError):
            while True:
                self.colours = pipe.recv()
                self.changed.set()
        self.over = True
        self.changed.set()


def seek(seeker: Seeker, wanted: Wanted) -> None:
    """Search frame after frame until it is over."""
    while not wanted.over:
        found, took = seeker.timed_step(wanted.colours)
        wanted.changed.wait(REST_S if found is None else BESIDE * took)
        wanted.changed.clear()
