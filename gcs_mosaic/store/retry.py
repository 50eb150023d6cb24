"""Writing to a disk that may be full or missing: report, wait, retry."""

from __future__ import annotations

import logging
import math
import sqlite3
import time
from collections.abc import Callable
from pathlib import Path
from typing import Protocol, TypeVar

from gcs_mosaic.messages import Notice, Topic
from gcs_mosaic.store.disk import CannotWrite

logger = logging.getLogger(__name__)

T = TypeVar("T")

SAID_AGAIN_S = 60.0  # a disk that is still full is reported again after this time


class Retry(Protocol):
    """Runs a repeatable write and returns its result."""

    def __call__(self, write: Callable[[], T], /) -> T: ...


def at_once(write: Callable[[], T], /) -> T:
    """Write once; failures propagate to the caller."""
    return write()


class UntilWritable:
    """Retries until the write succeeds.

    `wait(trouble)` pauses between two attempts; it raises `trouble` when time is up.
    """

    def __init__(self, out: Path, say: Callable[[Notice], None], wait: Callable[[CannotWrite], None]) -> None:
        self._out, self._say, self._wait = out, say, wait
        self._in_trouble = False
        self._said = -math.inf

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
        try:
            return write()
        except (OSError, sqlite3.OperationalError) as error:
            text = f"{self._out} cannot be written ({error}): bring it back, then it goes on"
            raise CannotWrite(text) from error

    def _tell(self, trouble: CannotWrite) -> None:
        self._in_trouble = True
        if time.monotonic() - self._said > SAID_AGAIN_S:
            self._said = time.monotonic()
            logger.warning("writing has failed", exc_info=trouble)
            self._say(Notice(source="disk", level="error", text=str(trouble), topic=Topic.DISK))

    def _tell_success(self) -> None:
        if self._in_trouble:
            self._in_trouble, self._said = False, -math.inf
            self._say(
                Notice(source="disk", level="info", text="the disk can be written again: going on", topic=Topic.DISK)
            )
