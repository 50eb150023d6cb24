"""Tiles that were asked for, kept until something near them is painted: many who look mostly look at the same."""

from __future__ import annotations

import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Iterator

from gcs_mosaic.views.tile_reader import EncodedTile
from gcs_mosaic.render.tile_grid import Tile, ancestor
from gcs_mosaic.web.change import Change, Painted

MOST_BYTES = 48 << 20
KEPT_S = 10.0  # also if nobody has told that it was painted: `check --repair` does not
EACH_BYTES = 500  # of one without data
Key = tuple[int, Tile]  # island, tile


class AnsweredTiles:
    """Thread-safe. A tile is filled from coarser ones and fades towards its neighbours, so it is forgotten with all of those."""

    def __init__(self, revision: Callable[[], int]) -> None:
        """`revision`: of what is on the disk now; what whoever asks says of it is not believed."""
        self._revision = revision
        self._lock = threading.Lock()
        # Since when, and of which revision at least; last asked for last.
        self._kept: OrderedDict[Key, tuple[float, int, EncodedTile | None]] = OrderedDict()
        self._bytes = 0
        self._changes = 0

    def get(self, island: int, tile: Tile, revision: int, make: Callable[[], EncodedTile | None]) -> EncodedTile | None:
        """The tile as it is kept, if it is of that revision or a later one, else as `make` makes it; None: nothing was seen."""
        with self._lock:
            since, known, kept = self._kept.get((island, tile), (-KEPT_S, -1, None))
            if time.monotonic() - since < KEPT_S and known >= revision:
                self._kept.move_to_end((island, tile))
                return kept
            before = self._changes
        known = self._revision()
        made = make()
        with self._lock:
            if self._changes == before:  # else it may be older than what has just been painted
                self._keep((island, tile), known, made)
        return made

    def forget(self, change: Change) -> None:
        """Something was painted."""
        with self._lock:
            self._changes += 1
            if change.painted is None:
                self._kept.clear()
                self._bytes = 0
                return
            near, above = set(_around(change.painted)), set(_around(_ancestors(change.painted)))
            for key in [key for key in self._kept if key in above or any(one in near for one in _upwards(key))]:
                self._drop(key)

    def _keep(self, key: Key, revision: int, made: EncodedTile | None) -> None:
        if key in self._kept:
            self._drop(key)
        self._kept[key] = time.monotonic(), revision, made
        self._bytes += _size(made)
        while self._bytes > MOST_BYTES:
            self._drop(next(iter(self._kept)))

    def _drop(self, key: Key) -> None:
        self._bytes -= _size(self._kept.pop(key)[2])


def _size(made: EncodedTile | None) -> int:
    return EACH_BYTES + (len(made.data) if made else 0)


def _upwards(key: Key) -> Iterator[Key]:
    """A tile and all those that contain it."""
    island, tile = key
    for level in range(tile.z, -1, -1):
        yield island, ancestor(tile, level)


def _ancestors(painted: Painted) -> Painted:
    return frozenset(one for key in painted for one in _upwards(key))


def _around(painted: Painted) -> Iterator[Key]:
    """The tiles and their neighbours."""
    for island, (z, x, y) in painted:
        for dx in (-1, 0, 1):
            for dy in (-1, 0, 1):
                yield island, Tile(z, x + dx, y + dy)
