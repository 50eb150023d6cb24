"""Tiles of the canvas that were asked for, kept until something near them is painted."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator

from gcs_mosaic.render.tile_grid import Tile, ancestor
from gcs_mosaic.views.tile_reader import EncodedTile
from gcs_mosaic.web.change import Change, PaintedTiles
from gcs_mosaic.web.recent_answers import RecentAnswers

MOST_BYTES = 48 << 20
EACH_BYTES = 500  # of one without data
Key = tuple[int, Tile]  # island, tile


class AnsweredTiles:
    """Thread-safe."""

    def __init__(self, revision: Callable[[], int]) -> None:
        self._kept: RecentAnswers[Key, EncodedTile | None] = RecentAnswers(revision, _size, MOST_BYTES, near_painted)

    def get(self, island: int, tile: Tile, revision: int, make: Callable[[], EncodedTile | None]) -> EncodedTile | None:
        """The tile as it is kept, if it is of that revision or a later one, else as `make` makes it; None: nothing was seen."""
        return self._kept.get((island, tile), revision, make)

    def forget(self, change: Change) -> None:
        """Something was painted."""
        self._kept.forget(change)


def near_painted(keys: Collection[Key], change: Change) -> Iterator[Key]:
    """A tile is filled from coarser ones and fades towards its neighbours, so it is spoilt with all of those."""
    painted = change.painted or frozenset()
    near, above = set(_around(painted)), set(_around(_ancestors(painted)))
    for key in keys:
        if key in above or any(one in near for one in _upwards(key)):
            yield key


def _size(made: EncodedTile | None) -> int:
    return EACH_BYTES + (len(made.data) if made else 0)


def _upwards(key: Key) -> Iterator[Key]:
    """A tile and all those that contain it."""
    island, tile = key
    for level in range(tile.z, -1, -1):
        yield island, ancestor(tile, level)


def _ancestors(painted: PaintedTiles) -> PaintedTiles:
    return frozenset(one for key in painted for one in _upwards(key))


def _around(painted: PaintedTiles) -> Iterator[Key]:
    """The tiles and their neighbours."""
    for island, (z, x, y) in painted:
        for dx in (-1, 0, 1):
            for dy in (-1, 0, 1):
                yield island, Tile(z, x + dx, y + dy)
