"""Which frames each super-tile needs, and which super-tiles there are, overviews included."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from gcs_mosaic.render.cells import around
from gcs_mosaic.render.frame_warp import frame_warp
from gcs_mosaic.render.pyramid import top_level
from gcs_mosaic.render.render_list import INSET_LEVELS, Extent, RenderItem
from gcs_mosaic.render.tile_grid import Box, Tile, join, tile_box

SIDE = 16  # tiles along a super-tile


class SuperTile(NamedTuple):
    """A square of tiles of one level of an island: row and column count squares of `side` tiles."""

    island: int
    level: int
    x: int
    y: int

    def tiles(self, side: int) -> Iterator[Tile]:
        most = 1 << self.level
        for y in range(self.y * side, min((self.y + 1) * side, most)):
            for x in range(self.x * side, min((self.x + 1) * side, most)):
                yield Tile(self.level, x, y)

    @property
    def above(self) -> SuperTile:
        return SuperTile(self.island, self.level - 1, self.x // 2, self.y // 2)

    def below(self) -> tuple[SuperTile, ...]:
        """The four of the next finer level, row by row."""
        return tuple(
            SuperTile(self.island, self.level + 1, 2 * self.x + x, 2 * self.y + y) for y in (0, 1) for x in (0, 1)
        )


def super_tile_of(island: int, tile: Tile, side: int) -> SuperTile:
    return SuperTile(island, tile.z, tile.x // side, tile.y // side)


@dataclass(frozen=True, slots=True)
class Footprint:
    """Where a frame is painted: its level and box, the super-tiles that it touches, and all that may depend on it."""

    island: int
    level: int
    box: Box
    touched: frozenset[SuperTile]
    near: frozenset[SuperTile]


def footprint(painted: RenderItem, side: int) -> Footprint | None:
    """Of a frame; None where it sees no ground."""
    frame = frame_warp(painted)
    if frame is None:
        return None
    island, tiles = painted.island, [tile for tile in frame.lattice.tiles() if tile.z == painted.level]
    if not tiles:
        return None
    near = around(around((island, tile) for tile in tiles))
    reached, level = {super_tile_of(island, tile, side) for _, tile in near}, near
    for _ in range(INSET_LEVELS):  # an inset shows on finer tiles
        level = {(island, child) for _, tile in level for child in tile.children}
        reached |= {super_tile_of(island, tile, side) for _, tile in level}
    xs, ys = [tile.x for tile in tiles], [tile.y for tile in tiles]
    corners = tile_box(Tile(painted.level, min(xs), min(ys))), tile_box(Tile(painted.level, max(xs), max(ys)))
    touched = frozenset(super_tile_of(island, tile, side) for tile in tiles)
    return Footprint(island, painted.level, join(*corners), touched, frozenset(reached))


@dataclass(frozen=True, slots=True)
class SuperTileLayout:
    """Extents by island; by super-tile the frames that it depends on, in order, none for those that show finer ones alone."""

    extents: dict[int, Extent] = field(default_factory=dict)
    frames: dict[SuperTile, tuple[int, ...]] = field(default_factory=dict)

    def levels(self) -> list[tuple[int, list[SuperTile]]]:
        """All levels, the finest first, with their super-tiles."""
        found: dict[int, list[SuperTile]] = {}
        for one in sorted(self.frames):
            found.setdefault(one.level, []).append(one)
        return sorted(found.items(), reverse=True)


def layout_of(footprints: Sequence[Footprint | None]) -> SuperTileLayout:
    """Of all frames."""
    seen = [(number, one) for number, one in enumerate(footprints) if one is not None]
    extents = _extents(one for _, one in seen)
    own = frozenset[SuperTile]().union(*(one.touched for _, one in seen))
    frames: dict[SuperTile, list[int]] = {tile: [] for tile in own}
    for number, one in seen:
        for tile in one.near & own:
            frames[tile].append(number)
    found = {tile: tuple(some) for tile, some in frames.items()}
    for tile in own:
        above = tile
        while above.level > extents[tile.island].coarsest:
            above = above.above
            found.setdefault(above, ())
    return SuperTileLayout(extents, found)


def _extents(footprints: Iterable[Footprint]) -> dict[int, Extent]:
    found: dict[int, Extent] = {}
    for one in footprints:
        new = Extent(one.box, one.level, one.level)
        known = found.get(one.island, new)
        box, coarsest, finest = join(known.box, new.box), min(known[1], new[1]), max(known[2], new[2])
        found[one.island] = Extent(box, coarsest, finest)
    return {island: extent._replace(coarsest=top_level(extent)) for island, extent in found.items()}
