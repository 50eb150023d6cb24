"""When a child process is started again, and when one that says nothing hangs."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterator

from gcs_mosaic.processes.child import ChildProcess

logger = logging.getLogger(__name__)

FIRST_PAUSE_S, LONGEST_PAUSE_S = 0.25, 10.0
LIVED_S = 30.0  # then what has ended a process is not its start
HUNG_S = 30.0  # each child that is watched gives a sign of life every few seconds
LONGEST_LOOK_S = 1.0


class Pauses:
    """Before a process is started again: none at first, then pauses that double up to a longest one, while none lives."""

    def __init__(self, longest_s: float = LONGEST_PAUSE_S) -> None:
        self._longest_s = longest_s
        self._next_s = 0.0

    def after(self, lived_s: float) -> float:
        """Seconds to wait after one has ended that has lived, or has been of use, for so many."""
        if lived_s > LIVED_S:
            self._next_s = 0.0
        pause_s = self._next_s
        self._next_s = min(self._longest_s, max(FIRST_PAUSE_S, 2 * pause_s))
        return pause_s

    def forget(self) -> None:
        """One has been of use."""
        self._next_s = 0.0


class Silence:
    """For how long nothing was heard of a process, while somebody looked: time for which this program or the machine was asleep
    counts as one look."""

    def __init__(self) -> None:
        self._looked, self._silent_s = time.monotonic(), 0.0

    def heard(self) -> None:
        self._silent_s = 0.0

    def is_too_long(self) -> bool:
        """To be asked every second or more often."""
        before, self._looked = self._looked, time.monotonic()
        self._silent_s += min(self._looked - before, LONGEST_LOOK_S)
        return self._silent_s > HUNG_S


def one_after_another(
    start: Callable[[], ChildProcess], what: str, stop: threading.Event, longest_pause_s: float = LONGEST_PAUSE_S
) -> Iterator[ChildProcess]:
    """A process, and when the caller is done with it, which ends it, the next one; until `stop` is set."""
    pauses = Pauses(longest_pause_s)
    while not stop.is_set():
        began = time.monotonic()
        try:
            child = start()
        except OSError:
            logger.warning("%s cannot be started", what, exc_info=True)
        else:
            try:
                yield child
            finally:
                child.end()
        stop.wait(pauses.after(time.monotonic() - began))
