"""Writing to a disk that may be full, missing, read-only or slow: report, wait, retry."""

from __future__ import annotations

import errno
import logging
import math
import sqlite3
import time
from collections.abc import Callable
from pathlib import Path
from typing import Protocol, TypeVar

from gcs_mosaic.messages import Notice, Topic
from gcs_mosaic.store.disk import CannotWrite, DiskFull

logger = logging.getLogger(__name__)

T = TypeVar("T")

SAID_AGAIN_S = 60.0  # a disk that is still full is reported again after this time
SAID_OTHERWISE_S = 10.0  # ... and another trouble with it after this
ADVICE = {
    errno.EROFS: "its disk is read-only now; make it writable",
    errno.EIO: "its disk reports errors; look at the cable, the card, the mount",
    errno.EACCES: "there is no permission any more; give it back",
    errno.EMFILE: "too many files are open",
    errno.ENFILE: "too many files are open on this computer",
}


class Retry(Protocol):
    """Runs a repeatable write and returns its result."""

    def __call__(self, write: Callable[[], T], /) -> T: ...


def at_once(write: Callable[[], T], /) -> T:
    """Write once; failures propagate to the caller."""
    return write()


class UntilWritable:
    """Retries until the write succeeds.

    `wait(trouble)` pauses between two attempts; it raises `trouble` when time is up. `ensure` is called before each attempt:
    it returns whether the folder had to be taken again, and raises as a write does while it cannot be had.
    """

    def __init__(
        self,
        out: Path,
        say: Callable[[Notice], None],
        wait: Callable[[CannotWrite], None],
        ensure: Callable[[], bool] = lambda: False,
    ) -> None:
        self._out, self._say, self._wait, self._ensure = out, say, wait, ensure
        self._said, self._said_kind = -math.inf, ""
        self.in_trouble = False  # the last attempt has failed

    def __call__(self, write: Callable[[], T], /) -> T:
        """The result of `write`, which must be repeatable. Raises CannotWrite when time is up."""
        while True:
            try:
                written = self._attempt(write)
            except CannotWrite as trouble:
                self._tell(trouble)
                self._wait(trouble)
            else:
                self._tell_success()
                return written

    def _attempt(self, write: Callable[[], T]) -> T:
        self._in_words(self._ensure)
        try:
            return self._in_words(write)
        except DiskFull:
            raise
        except CannotWrite:
            if not self._in_words(self._ensure):  # raises in better words if the folder is the reason
                raise
        return self._in_words(write)  # the folder was gone, which nobody need be told of: it has been taken again

    def _in_words(self, attempt: Callable[[], T]) -> T:
        try:
            return attempt()
        except (OSError, sqlite3.OperationalError) as error:
            why = ADVICE.get(getattr(error, "errno", None) or 0, "bring it back")
            raise CannotWrite(f"{self._out} cannot be written ({error}): {why}, then it goes on") from error

    def _tell(self, trouble: CannotWrite) -> None:
        self.in_trouble = True
        kind = "full" if isinstance(trouble, DiskFull) else str(trouble)
        since = time.monotonic() - self._said
        if since > (SAID_AGAIN_S if kind == self._said_kind else SAID_OTHERWISE_S):
            self._said, self._said_kind = time.monotonic(), kind
            logger.warning("writing has failed", exc_info=trouble)
            self._say(Notice(source="disk", level="error", text=str(trouble), topic=Topic.DISK))

    def _tell_success(self) -> None:
        if self.in_trouble:
            self.in_trouble, self._said = False, -math.inf
            self._say(
                Notice(source="disk", level="info", text="the disk can be written again: going on", topic=Topic.DISK)
            )
