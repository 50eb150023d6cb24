"""What was asked for lately, kept until it is spoilt by something that is painted: many who look mostly look at the same."""

from __future__ import annotations

import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Collection, Iterable
from typing import Generic, TypeVar

from gcs_mosaic.web.change import Change

KEPT_S = 10.0  # also if nobody has told that it was painted: `check --repair` does not
SPOILT = float("-inf")  # in place of when it was made

Key = TypeVar("Key")
Value = TypeVar("Value")


class RecentAnswers(Generic[Key, Value]):
    """Thread-safe; what was asked for last is kept longest."""

    def __init__(
        self,
        revision: Callable[[], int],
        size: Callable[[Value], int],
        most_bytes: int,
        spoilt: Callable[[Collection[Key], Change], Iterable[Key]],
        *,
        keeps_spoilt: bool = False,
    ) -> None:
        """`revision`: of what is on the disk now; what whoever asks says of it is not believed. `spoilt`: those of some keys
        whose values a change may have made wrong; they are forgotten, or kept for `earlier` only."""
        self._revision, self._size, self._most_bytes, self._spoilt = revision, size, most_bytes, spoilt
        self._keeps_spoilt = keeps_spoilt
        self._lock = threading.Lock()
        # Since when, and of which revision at least; last asked for last.
        self._kept: OrderedDict[Key, tuple[float, int, Value]] = OrderedDict()
        self._bytes = 0
        self._changes = 0

    @property
    def changes(self) -> int:
        """How many there were."""
        return self._changes

    def get(self, key: Key, revision: int, make: Callable[[], Value], changes: int | None = None) -> Value:
        """What is kept, if it is of that revision or a later one, else what `make` makes.

        `changes`: when all was looked up that `make` goes by; after a later change what it makes is not kept.
        """
        with self._lock:
            known = self._kept.get(key)
            if known is not None and time.monotonic() - known[0] < KEPT_S and known[1] >= revision:
                self._kept.move_to_end(key)
                return known[2]
            before = self._changes if changes is None else changes
        on_disk = self._revision()
        made = make()
        with self._lock:
            if self._changes == before:  # else it may be older than what has just been painted
                self._keep(key, on_disk, made)
        return made

    def earlier(self, key: Key) -> Value | None:
        """What was kept last, spoilt or not, unless it was pushed out."""
        with self._lock:
            known = self._kept.get(key)
            return None if known is None else known[2]

    def forget(self, change: Change) -> None:
        """Something was painted."""
        with self._lock:
            self._changes += 1
            keys = self._kept.keys()
            for key in list(keys if change.painted is None else self._spoilt(keys, change)):
                if self._keeps_spoilt:
                    self._kept[key] = SPOILT, 0, self._kept[key][2]
                else:
                    self._drop(key)

    def _keep(self, key: Key, revision: int, made: Value) -> None:
        if key in self._kept:
            self._drop(key)
        self._kept[key] = time.monotonic(), revision, made
        self._bytes += self._size(made)
        while self._bytes > self._most_bytes:
            self._drop(next(iter(self._kept)))

    def _drop(self, key: Key) -> None:
        self._bytes -= self._size(self._kept.pop(key)[2])
