"""Tile pyramid: each tile's own layer, and the quarter of its parent made from it."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

import cv2
import numpy as np

from gcs_mosaic.render.overviews import assemble, composite, shrink
from gcs_mosaic.render.render_list import Extent, TileKey
from gcs_mosaic.render.spread import spread
from gcs_mosaic.render.tile_cache import Layer, Store, make_layer
from gcs_mosaic.render.tile_grid import FINEST_LEVEL, Box, Tile, overview_level, tiles_over
from gcs_mosaic.render.warp_grid import LATTICE
from gcs_mosaic.stitch.arrays import Bands, Coverage, ImageBGR, Lattice
from gcs_mosaic.stitch.transaction import Kept

T = TypeVar("T")

AT_ONCE = 64  # tiles taken from the store together, 25 MB: enough to keep every thread busy
UNKNOWN_WEIGHT = 0.5  # of tiles painted by an earlier run, until repainted


@dataclass(frozen=True, slots=True, eq=False)
class TilePicture:
    """A tile as displayed: `colour` (256, 256, 3) BGR and `coverage` (256, 256), from 0, nothing seen, to 255, fully covered;
    `bands` (256, 256, bands) if the canvas keeps them."""

    colour: ImageBGR
    coverage: Coverage
    bands: Bands | None = None


LoadTile = Callable[[int, Tile], TilePicture | None]


class TileStack(Kept):
    """Layers of tiles in a store. A non-empty tile below its island's top level has a quarter.

    `load_tile` returns tiles written by an earlier run; they are placeholders until repainted. The store is restored by its
    owner.
    """

    FIXED = frozenset({"_store", "_pool", "_load_tile"})

    def __init__(self, store: Store, pool: Executor, load_tile: LoadTile | None = None) -> None:
        self._store = store
        self._pool = pool
        self._load_tile = load_tile
        self._earlier_own: set[TileKey] = set()
        self.earlier: set[TileKey] = set()  # of which only an earlier run knows more
        self._tops: dict[int, tuple[Box, int]] = {}

    def own(self, key: TileKey) -> Layer | None:
        """The blend of the frames painted at the tile's level."""
        if key in self._earlier_own:
            self.set_own(key, self._load(key))
        layer: Layer | None = self._store.get((key, "own"))
        return layer

    def set_own(self, key: TileKey, layer: Layer | None) -> None:
        self._earlier_own.discard(key)
        self._store.put((key, "own"), layer)

    def take_own(self, key: TileKey, under: Hashable) -> bool:
        """Move the store's value at another key to the tile's own layer; False if there is none."""
        self._earlier_own.discard(key)
        self._store.take_over((key, "own"), under)
        return (key, "own") in self._store

    def expect(self, keys: Iterable[TileKey]) -> None:
        """An earlier run painted frames on these tiles, and wrote them and all tiles above."""
        if self._load_tile is None:
            return
        for key in keys:
            self._earlier_own.add(key)
            island, tile = key
            while tile.z >= 0 and (island, tile) not in self.earlier:
                self.earlier.add((island, tile))
                tile = tile.parent

    def shown(self, key: TileKey) -> Callable[[], TilePicture | None]:
        """Everything of a tile, combined when called, in any thread."""
        return partial(_shown, self.own(key), self._quarters(key))

    def refresh(self, painted: Iterable[TileKey], extents: dict[int, Extent | None]) -> set[TileKey]:
        """Update the tiles above the painted ones; returns all tiles that may have changed.

        `extents`: of the islands of these tiles.
        """
        waiting: dict[int, set[TileKey]] = {level: set() for level in range(-1, FINEST_LEVEL + 1)}
        gone = set()
        for island, extent in extents.items():
            gone |= self._retop(island, extent, waiting)
        for key in painted:
            waiting[key[1].z].add(key)
        for level in range(FINEST_LEVEL, -1, -1):
            below_top = [key for key in waiting[level] if level > self._tops[key[0]][1]]
            self.earlier -= waiting[level]  # before the level above asks: one that is empty now must not be read again
            self._shrink_all(below_top)
            waiting[level - 1] |= {(island, tile.parent) for island, tile in below_top}
        return gone.union(*waiting.values())

    def _retop(self, island: int, extent: Extent | None, waiting: dict[int, set[TileKey]]) -> set[TileKey]:
        """Follow an island that has grown or shrunk; returns the tiles above its new top level, which are removed."""
        old = self._tops.get(island)
        if extent is None:
            self._tops.setdefault(island, ((0.0, 0.0, 0.0, 0.0), 0))
            return set()
        top = top_level(extent)
        self._tops[island] = extent.box, top
        if old is None:
            return self._above_top(island, top)
        if old[1] == top:
            return set()
        old_box, old_top = old
        if top < old_top:
            waiting[old_top] |= {(island, tile) for tile in tiles_over(old_box, old_top)}
            return set()
        for level in range(old_top + 1, top + 1):
            for tile in tiles_over(old_box, level):
                self._store.put(((island, tile), "quarter"), None)
        return {(island, tile) for level in range(old_top, top) for tile in tiles_over(old_box, level)}

    def _above_top(self, island: int, top: int) -> set[TileKey]:
        """Tiles that an earlier run may have left there, when the island was larger."""
        known = {key for key in self.earlier if key[0] == island and key[1].z <= top}
        self.earlier -= known  # nor is anything to be shrunk from the top level upwards
        return {key for key in known if key[1].z < top}

    def _shrink_all(self, keys: Sequence[TileKey]) -> None:
        for some in chunks(sorted(keys), AT_ONCE):
            parts = [(self.own(key), self._quarters(key)) for key in some]
            for key, quarter in zip(some, spread(self._pool, _quarter_of, parts), strict=True):
                self._store.put((key, "quarter"), quarter)

    def _quarters(self, key: TileKey) -> list[Layer | None]:
        island, tile = key
        return [self._quarter((island, child)) for child in tile.children]

    def _quarter(self, key: TileKey) -> Layer | None:
        quarter: Layer | None = self._store.get((key, "quarter"))
        if quarter is None and key in self.earlier:
            layer = self._load(key)
            quarter = None if layer is None else shrink(layer)
            self._store.put((key, "quarter"), quarter)
        return quarter

    def _load(self, key: TileKey) -> Layer | None:
        picture = None if self._load_tile is None else self._load_tile(*key)
        return None if picture is None else make_layer(picture.colour, picture.coverage, _guessed_weight(picture))


def top_level(extent: Extent) -> int:
    """The top level of an island's tiles, where it fits into two by two."""
    return overview_level(extent.box, extent.coarsest)


def chunks(items: Sequence[T], size: int) -> Iterator[Sequence[T]]:
    return (items[i : i + size] for i in range(0, len(items), size))


def _shown(own: Layer | None, quarters: Sequence[Layer | None]) -> TilePicture | None:
    layer = composite(own, assemble(quarters))
    return None if layer is None else TilePicture(layer.colour, layer.coverage, layer.bands)


def _quarter_of(parts: tuple[Layer | None, list[Layer | None]]) -> Layer | None:
    own, quarters = parts
    layer = composite(own, assemble(quarters))
    return None if layer is None else shrink(layer)


def _guessed_weight(picture: TilePicture) -> Lattice:
    seen = (picture.coverage > 0).astype(np.float32) * UNKNOWN_WEIGHT
    return np.asarray(cv2.resize(seen, (LATTICE, LATTICE), interpolation=cv2.INTER_AREA))
