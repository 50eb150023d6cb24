"""Tiles of the canvas that were asked for, kept until something near them is painted, and the masks they were made by.

Most of what is painted near a tile changes nothing of it: one that was kept is looked at, and made anew if it is not the same.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from functools import partial
from pathlib import Path

from gcs_mosaic.render.tile_cache import full_coverage
from gcs_mosaic.render.tile_grid import TILE_SIZE, Tile, ancestor
from gcs_mosaic.stitch.arrays import Coverage
from gcs_mosaic.store.tiles import ReadMask, read_mask
from gcs_mosaic.views.tile_reader import EncodedTile
from gcs_mosaic.web.change import Change, PaintedTiles
from gcs_mosaic.web.recent_answers import RecentAnswers

MOST_BYTES = 48 << 20
MOST_MASK_BYTES = 24 << 20  # of some 370 tiles that are not full
EACH_BYTES = 500  # of one without data
SOURCE_BYTES = 350  # of what is noted of one tile that was read
Make = Callable[[EncodedTile | None], EncodedTile | None]  # given what was kept before
Key = tuple[int, Tile]  # island, tile


class AnsweredTiles:
    """Thread-safe."""

    def __init__(self, revision: Callable[[], int]) -> None:
        self._kept: RecentAnswers[Key, EncodedTile | None] = RecentAnswers(
            revision, _size, MOST_BYTES, near_painted, keeps_spoilt=True
        )
        self._masks: RecentAnswers[Key, Coverage | None] = RecentAnswers(
            revision, _mask_size, MOST_MASK_BYTES, _painted_anew
        )

    def get(self, island: int, tile: Tile, revision: int, make: Make) -> EncodedTile | None:
        """The tile as it is kept, if it is of that revision or a later one, else as `make` makes it; None: nothing was seen."""
        key = island, tile
        return self._kept.get(key, revision, lambda: make(self._kept.earlier(key)))

    def masks(self, revision: int) -> ReadMask:
        """Masks of that revision or a later one, not to be modified: each is asked for by all tiles around it and below. It
        raises FileNotFoundError where the flight's folder is gone: that no tile is there then is not to be kept."""

        def mask(root: Path, island: int, tile: Tile) -> Coverage | None:
            return self._masks.get((island, tile), revision, partial(_mask, root, island, tile))

        return mask

    def forget(self, change: Change) -> None:
        """Something was painted."""
        self._masks.forget(change)  # first: a tile that is begun now is kept, and must not be made by an old one
        self._kept.forget(change)


def near_painted(keys: Collection[Key], change: Change) -> Iterator[Key]:
    """A tile is filled from coarser ones and fades towards its neighbours, so it is spoilt with all of those."""
    painted = change.painted or frozenset()
    near, above = set(_around(painted)), set(_around(_ancestors(painted)))
    for key in keys:
        if key in above or any(one in near for one in _upwards(key)):
            yield key


def _painted_anew(keys: Collection[Key], change: Change) -> Collection[Key]:
    """The masks of painted tiles and of all that contain these are spoilt."""
    return _ancestors(change.painted or frozenset()) & set(keys)


def _mask(root: Path, island: int, tile: Tile) -> Coverage | None:
    found = read_mask(root, island, tile)
    if found is None and not root.is_dir():
        raise FileNotFoundError(root)
    return found


def _mask_size(mask: Coverage | None) -> int:
    return EACH_BYTES if mask is None or mask is full_coverage(TILE_SIZE) else EACH_BYTES + mask.nbytes


def _size(made: EncodedTile | None) -> int:
    return EACH_BYTES + (len(made.data) + SOURCE_BYTES * len(made.made_of) if made else 0)


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
