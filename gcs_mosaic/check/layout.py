"""Which tiles a flight's painted frames touch, and which of those must be there."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass

from gcs_mosaic.render.cells import around
from gcs_mosaic.render.compositor import TileCompositor
from gcs_mosaic.render.frame_warp import frame_warp
from gcs_mosaic.render.render_list import INSET_LEVELS, Extent, RenderItem, TileKey
from gcs_mosaic.render.tile_grid import ancestor


@dataclass(frozen=True, slots=True)
class Layout:
    """`touched`: tiles of each frame on its own level, by name; `filled`: those of them that it fills by itself."""

    touched: dict[str, frozenset[TileKey]]
    filled: dict[str, frozenset[TileKey]]
    extents: dict[int, Extent]  # of the islands; `coarsest` is that of the overviews

    def possible(self) -> set[TileKey]:
        """All tiles that may be there, overviews included."""
        return self._with_overviews(set[TileKey]().union(*self.touched.values()))

    def required(self) -> set[TileKey]:
        """Tiles that must be there, overviews included."""
        return self._with_overviews(set[TileKey]().union(*self.filled.values()))

    def unsure(self, gone: Collection[str]) -> set[TileKey]:
        """Tiles that may look different without these frames."""
        own = set[TileKey]().union(*(self.touched[name] for name in gone if name in self.touched))
        near = around(around(own))
        below = near
        for _ in range(INSET_LEVELS):
            below = {(island, child) for island, tile in below for child in tile.children}
            near = near | below
        return self._with_overviews(near)

    def _with_overviews(self, keys: Iterable[TileKey]) -> set[TileKey]:
        own = set(keys)
        return own | {above for key in own for above in self._above(key)}

    def _above(self, key: TileKey) -> Iterator[TileKey]:
        island, tile = key
        if island in self.extents:
            yield from ((island, ancestor(tile, level)) for level in range(self.extents[island].coarsest, tile.z))


def layout_of(painted: Iterable[RenderItem]) -> Layout:
    """Where these frames are painted."""
    frames = list(painted)
    touched, filled = dict[str, frozenset[TileKey]](), dict[str, frozenset[TileKey]]()
    for one in frames:
        frame = frame_warp(one)
        if frame is not None:
            lattice = frame.lattice
            tiles = [tile for tile in lattice.tiles() if tile.z == one.level]
            seen = lattice.inside() & (lattice.weight > 0)
            touched[one.name] = frozenset((one.island, tile) for tile in tiles)
            filled[one.name] = frozenset((one.island, tile) for tile in tiles if seen[lattice.window(tile)].all())
    return Layout(touched, filled, _extents(frames))


def _extents(frames: list[RenderItem]) -> dict[int, Extent]:
    with TileCompositor(lambda name: None) as canvas:
        canvas.resume(frames)
        found = {island: canvas.extent(island) for island in {one.island for one in frames}}
    return {island: extent for island, extent in found.items() if extent is not None}
