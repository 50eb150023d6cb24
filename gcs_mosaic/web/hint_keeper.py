"""The process that seeks hints, kept up beside the page for as long as somebody wants hints."""

from __future__ import annotations

import logging
import threading
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Literal

from gcs_mosaic.hints.hint_process import seek_hints
from gcs_mosaic.hints.settings import HintSettings
from gcs_mosaic.hints.sought import SoughtColour
from gcs_mosaic.notes.search.hint_wishes import PickedColour
from gcs_mosaic.processes.child import ChildProcess, ending
from gcs_mosaic.processes.keeper import one_after_another
from gcs_mosaic.processes.pipe import Message, messages, was_logged

logger = logging.getLogger(__name__)

WHAT = "the process that seeks hints"
NICENESS = 15  # of 19: the flight and its page come first
LONGEST_PAUSE_S = 60.0  # before another is started: nobody waits for it, and loading a model takes from the flight
LOOK_S = 0.2  # longest delay of a wish

State = Literal["off", "starting", "seeking", "refused"]


class HintKeeper:
    """Runs from `start` to `stop`. `state` and `trouble` are for whoever looks."""

    def __init__(self, root: Path, settings: HintSettings) -> None:
        self.state: State = "off"
        self.trouble = ""  # a sentence, if hints cannot be sought
        self._root, self._settings = root, settings
        self._asked: bool | None = None
        self._colours: Sequence[PickedColour] = ()
        self._is_over = False
        self._unwanted, self._news = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._keep, name="hints", daemon=True)

    @property
    def is_asked(self) -> bool:
        """Whether hints are to be sought: as somebody has said on the page, else by the settings."""
        return self._settings.enabled if self._asked is None else self._asked

    def wish(self, asked: bool | None, colours: Sequence[PickedColour]) -> None:
        """What is wanted now; `asked` None: as the settings say."""
        if (asked, list(colours)) != (self._asked, list(self._colours)):
            self._asked, self._colours = asked, list(colours)
            self._pass_on()

    def start(self) -> None:
        self._pass_on()
        self._thread.start()

    def stop(self) -> None:
        """Returns when the process has ended, which takes some seconds at most."""
        self._is_over = True
        self._pass_on()
        self._thread.join()

    def _pass_on(self) -> None:
        if self.is_asked and not self._is_over:
            self._unwanted.clear()
        else:
            self._unwanted.set()
        self._news.set()

    def _keep(self) -> None:
        """Have the process while it is wanted."""
        while not self._is_over:
            for child in one_after_another(self._begun, WHAT, self._unwanted, LONGEST_PAUSE_S):
                self._serve(child)
            self.state, self.trouble = "off", ""
            self._news.wait()
            self._news.clear()

    def _begun(self) -> ChildProcess:
        self.state = "starting"
        try:
            return ChildProcess(WHAT, seek_hints, self._root.absolute(), self._settings, niceness=NICENESS)
        except OSError:
            self.trouble = "The process that seeks hints cannot be started now; it is tried again."
            raise

    def _serve(self, child: ChildProcess) -> None:
        """Tell what is wanted, and hear, until nothing is wanted or the process has ended."""
        told: Sequence[PickedColour] | None = None
        with suppress(EOFError, OSError):
            while not self._unwanted.is_set():
                if told is not self._colours:
                    told = self._colours
                    child.pipe.send([SoughtColour(number=one.id, bgr=one.bgr, tolerance=one.tolerance) for one in told])
                for message, _ in messages(child.pipe, LOOK_S):
                    self._hear(message)
        if not self._unwanted.is_set() and self.state != "refused":
            logger.warning("%s has ended (%s); it is started again", WHAT, ending(child.end()))
            self.state, self.trouble = "starting", "The process that seeks hints has ended; it is started again."

    def _hear(self, message: Message) -> None:
        if was_logged(message, WHAT):
            return
        if "ready" in message:
            self.state, self.trouble = "seeking", ""
        elif "refused" in message:
            self.state, self.trouble = "refused", str(message["refused"])
