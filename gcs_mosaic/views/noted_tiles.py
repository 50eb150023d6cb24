"""Tiles that note what was read of them: a filled tile is a function of that, and need not be made again while it is the same."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from gcs_mosaic.render.pyramid import TilePicture
from gcs_mosaic.render.tile_cache import full_coverage
from gcs_mosaic.render.tile_grid import TILE_SIZE, Tile
from gcs_mosaic.stitch.arrays import Coverage
from gcs_mosaic.store.tiles import ReadMask, decoded_tile, tile_bytes, tile_path

DIGEST_BYTES = 8
FULL = b"full"
Digest = bytes | None  # None: of nothing


@dataclass(frozen=True, slots=True)
class TilesRead:
    """What was read of which tiles."""

    masks: Mapping[Tile, Digest] = field(default_factory=dict)
    pictures: Mapping[Tile, Digest] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.masks) + len(self.pictures)


class NotedTiles:
    """The tiles of an island in a flight's folder, each file as it was when it was first read. `masks` as for
    `hole_filling.WrittenTiles`."""

    def __init__(self, root: Path, island: int, masks: ReadMask) -> None:
        self._root, self._island, self._read_mask = root, island, masks
        self._masks: dict[Tile, Coverage | None] = {}
        self._data: dict[Tile, bytes | None] = {}

    def read_so_far(self) -> TilesRead:
        """What was read so far."""
        masks = {tile: _of_mask(mask) for tile, mask in self._masks.items()}
        return TilesRead(masks, {tile: _digest(data) for tile, data in self._data.items()})

    def are_as(self, then: TilesRead) -> bool:
        """Whether all that was read then is the same now."""
        masks = all(_of_mask(self.mask(tile)) == found for tile, found in then.masks.items())
        return masks and all(_digest(self.data(tile)) == found for tile, found in then.pictures.items())

    def picture(self, tile: Tile) -> TilePicture | None:
        """As of `hole_filling.Tiles`."""
        data = self.data(tile)
        return None if data is None else decoded_tile(data, lambda: self.mask(tile))

    def mask(self, tile: Tile) -> Coverage | None:
        """As of `hole_filling.Tiles`."""
        if tile not in self._masks:
            self._masks[tile] = self._read_mask(self._root, self._island, tile)
        return self._masks[tile]

    def data(self, tile: Tile) -> bytes | None:
        """The bytes of its picture; None if there are none that can be read."""
        if tile not in self._data:
            self._data[tile] = tile_bytes(tile_path(self._root, self._island, tile), self._root)
        return self._data[tile]


def _of_mask(mask: Coverage | None) -> Digest:
    return FULL if mask is full_coverage(TILE_SIZE) else _digest(None if mask is None else mask.tobytes())


def _digest(data: bytes | None) -> Digest:
    return None if data is None else hashlib.blake2b(data, digest_size=DIGEST_BYTES).digest()
