"""Render list: which frames are painted, where and in what order. Tiles depend on nothing else."""

from __future__ import annotations

import heapq
from bisect import bisect
from collections.abc import Iterable
from dataclasses import dataclass
from functools import reduce
from typing import NamedTuple

import numpy as np

from gcs_mosaic.render.display import PLAIN, Display
from gcs_mosaic.render.light_field import LightField, apart, at_places
from gcs_mosaic.render.tile_grid import Box, Tile, ancestor, join, tile_box
from gcs_mosaic.render.vignetting import FLAT, OUTWARDS, Vignetting, log_brightness, radii
from gcs_mosaic.stitch.arrays import FloatRows
from gcs_mosaic.stitch.camera.dead_border import NO_BORDER, DeadBorder
from gcs_mosaic.stitch.camera.geometry import Camera, Pose
from gcs_mosaic.stitch.camera.picture_area import PictureArea
from gcs_mosaic.stitch.camera.relief import ReliefDisplacement
from gcs_mosaic.stitch.camera.still_mask import StillMask
from gcs_mosaic.stitch.transaction import Kept

TileKey = tuple[int, Tile]  # island, tile
Turn = tuple[int, str]  # position in capture order: `order`, then name

INSET_LEVELS = 2  # maximum level difference of an inset: frames coarser than that resolve no people


@dataclass(frozen=True, slots=True, kw_only=True)
class RenderItem:
    """A frame as it is (to be) painted. `gain` multiplies each band above the display's black, `vignetting` is removed, `light`
    applied; `dead` pixels of `camera`'s image, and those outside of `area`, are left out, those under an overlay (`still`) shown
    only where no other frame sees the place; `level` is usually the one that suits the frame alone, see
    `warp_grid.resolved`."""

    name: str
    order: int  # capture order
    island: int
    pose: Pose
    camera: Camera
    relief: ReliefDisplacement | None = None
    gain: tuple[float, ...] = (1.0, 1.0, 1.0)
    vignetting: Vignetting = FLAT
    light: LightField | None = None
    display: Display = PLAIN
    dead: DeadBorder = NO_BORDER
    still: StillMask | None = None
    area: PictureArea | None = None
    level: int

    @property
    def turn(self) -> Turn:
        return self.order, self.name


def brightness_apart(one: RenderItem, other: RenderItem) -> float:
    """Maximum difference in log brightness, anywhere in the frame and in any band, or somewhat more."""
    gains = np.log(np.array(one.gain) / np.array(other.gain))
    falls = log_brightness(other.vignetting, OUTWARDS) - log_brightness(one.vignetting, OUTWARDS)
    return float(np.abs(gains + falls).max()) + apart(one.light, other.light)


def log_compensation(painted: RenderItem, places: FloatRows) -> FloatRows:
    """What gain and vignetting add to the log brightness (n, bands) at places (n, 2), fractions of the frame's size."""
    width, height = painted.camera.width, painted.camera.height
    pixels = places.astype(np.float64) * [width, height] - 0.5
    fall = log_brightness(painted.vignetting, radii(pixels, width, height))
    return np.asarray(np.log(np.array(painted.gain)) - fall, np.float32)


def log_tones(painted: RenderItem, places: FloatRows) -> FloatRows:
    """As `log_compensation`, with the light field: all that a frame's levels are changed by before they are painted."""
    return np.asarray(log_compensation(painted, places) + at_places(painted.light, places), np.float32)


class Extent(NamedTuple):
    """Extent of an island."""

    box: Box  # canvas, of whole tiles
    coarsest: int  # level
    finest: int  # level


@dataclass(frozen=True, slots=True)
class RenderEntry:
    """A frame, and the tiles of its level that it touches."""

    painted: RenderItem
    tiles: tuple[Tile, ...]
    box: Box | None


class RenderList(Kept):
    """The painted frames by name, tile and island; pure bookkeeping."""

    FIXED = frozenset({"_tiles"})

    def __init__(self) -> None:
        self._entries: dict[str, RenderEntry] = {}
        self._turns: dict[TileKey, tuple[Turn, ...]] = {}  # in capture order
        self._islands: dict[int, frozenset[str]] = {}
        self._levels: dict[tuple[int, int], int] = {}  # number of frames by island and level
        self._tiles: dict[Tile, Tile] = {}

    def __contains__(self, name: str) -> bool:
        return name in self._entries

    def __getitem__(self, name: str) -> RenderItem:
        return self._entries[name].painted

    def entries(self) -> dict[str, RenderEntry]:
        """All frames by name."""
        return dict(self._entries)

    def get(self, name: str) -> RenderItem | None:
        entry = self._entries.get(name)
        return None if entry is None else entry.painted

    def add(self, painted: RenderItem, tiles: Iterable[Tile]) -> set[TileKey]:
        """Add or replace a frame; returns the tiles it touches now."""
        self.remove(painted.name)
        touched, turn = tuple(self._shared(tile) for tile in tiles), painted.turn
        entry = RenderEntry(painted, touched, _box_of_tiles(touched) if touched else None)
        self._entries[painted.name] = entry
        self._islands[painted.island] = self._islands.get(painted.island, frozenset()) | {painted.name}
        self._count(painted, 1)
        for tile in entry.tiles:
            turns = self._turns.get((painted.island, tile), ())
            at = bisect(turns, turn)
            self._turns[painted.island, tile] = (*turns[:at], turn, *turns[at:])
        return self.tiles_of(painted.name)

    def remove(self, name: str) -> set[TileKey]:
        """Remove a frame; returns the tiles it touched."""
        keys = self.tiles_of(name)
        entry = self._entries.pop(name, None)
        if entry is not None:
            self._islands[entry.painted.island] -= {name}
            self._count(entry.painted, -1)
            for key in keys:
                turns = tuple(turn for turn in self._turns.pop(key) if turn != entry.painted.turn)
                if turns:
                    self._turns[key] = turns
        return keys

    def tiles_of(self, name: str) -> set[TileKey]:
        entry = self._entries.get(name)
        return set() if entry is None else {(entry.painted.island, tile) for tile in entry.tiles}

    def on(self, key: TileKey) -> list[RenderItem]:
        """The frames that touch a tile, in capture order."""
        return [self[name] for _, name in self._turns.get(key, ())]

    def insets_on(self, key: TileKey) -> list[RenderItem]:
        """Frames of coarser levels that may touch a tile that has frames of its own, in capture order."""
        island, tile = key
        if key not in self._turns:
            return []
        above = [(island, ancestor(tile, tile.z - up)) for up in range(1, min(INSET_LEVELS, tile.z) + 1)]
        return [self[name] for _, name in sorted(turn for one in above for turn in self._turns.get(one, ()))]

    def hosts_below(self, keys: Iterable[TileKey]) -> set[TileKey]:
        """Finer tiles on which frames of these tiles may be insets."""
        hosts, below = set[TileKey](), set(keys)
        for _ in range(INSET_LEVELS):
            below = {(i, child) for i, tile in below if self._has_finer(i, tile.z) for child in tile.children}
            hosts |= self._turns.keys() & below
        return hosts

    def is_last(self, painted: RenderItem, key: TileKey) -> bool:
        return self._turns[key][-1] == painted.turn

    def next_after(self, turn: Turn | None, keys: Iterable[TileKey], count: int = 1) -> list[RenderItem]:
        """The first frames captured after `turn` that touch any of these tiles, at most so many."""
        later = set[Turn]()
        for key in keys:
            turns = self._turns.get(key, ())
            later.update(turns if turn is None else turns[bisect(turns, turn) :])
        return [self[name] for _, name in heapq.nsmallest(count, later)]

    def _shared(self, tile: Tile) -> Tile:
        """One object for each tile, whichever frames touch it: there are a hundred to a frame, and each is the key of much."""
        return self._tiles.setdefault(tile, tile)

    def _has_finer(self, island: int, level: int) -> bool:
        return any((island, level + down) in self._levels for down in range(1, INSET_LEVELS + 1))

    def _count(self, painted: RenderItem, more: int) -> None:
        where = painted.island, painted.level
        self._levels[where] = self._levels.get(where, 0) + more
        if not self._levels[where]:
            del self._levels[where]

    def extent(self, island: int) -> Extent | None:
        """Box around an island's tiles and the range of levels its frames are painted at; None if it has no tiles."""
        entries = [self._entries[name] for name in self._islands.get(island, ())]
        extents = [Extent(e.box, e.painted.level, e.painted.level) for e in entries if e.box is not None]
        return reduce(_joined, extents) if extents else None


def _joined(a: Extent, b: Extent) -> Extent:
    return Extent(join(a.box, b.box), min(a.coarsest, b.coarsest), max(a.finest, b.finest))


def _box_of_tiles(tiles: tuple[Tile, ...]) -> Box:
    level, xs, ys = tiles[0].z, [t.x for t in tiles], [t.y for t in tiles]
    return join(tile_box(Tile(level, min(xs), min(ys))), tile_box(Tile(level, max(xs), max(ys))))
