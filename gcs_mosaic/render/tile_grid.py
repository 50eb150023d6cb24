"""The tile grid: standard XYZ, 256 px, finer with growing z, y down; level 16 has one pixel per canvas unit.

Pixel k of level z covers canvas [k, k+1) * 2**(16-z) - 2**23 - 1/2, the same in x and y, so that at level 16 pixel centres are
integer canvas units, indices are never negative and no tile is ever renamed however the mosaic grows. Boxes are (left, top,
right, bottom) in canvas units, outer edges.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from gcs_mosaic.stitch.arrays import Array, PointsNx2

TILE_SIZE = 256  # px
BASE_LEVEL = 16  # one tile pixel per canvas unit
FINEST_LEVEL = 24  # 1/256 canvas unit; finer than anything measured
HALF_SPAN = 2.0**23  # canvas units from the centre of the grid to its edge
RESOLUTION_LOSS = 0.2  # of a frame's linear resolution, sacrificed rather than painting four times the pixels
SAME_HEIGHT = 1.15  # tolerance of a frame's ground sampling distance for the level of others

Box = tuple[float, float, float, float]


class Tile(NamedTuple):
    z: int
    x: int
    y: int

    @property
    def parent(self) -> Tile:
        return Tile(self.z - 1, self.x >> 1, self.y >> 1)

    @property
    def children(self) -> tuple[Tile, Tile, Tile, Tile]:
        """Top left, top right, bottom left, bottom right."""
        z, x, y = self.z + 1, 2 * self.x, 2 * self.y
        return Tile(z, x, y), Tile(z, x + 1, y), Tile(z, x, y + 1), Tile(z, x + 1, y + 1)


def ancestor(tile: Tile, level: int) -> Tile:
    """The tile of a coarser (or the same) level that contains this one."""
    up = tile.z - level
    return Tile(level, tile.x >> up, tile.y >> up)


def pixel_size(level: int) -> float:
    """Canvas units per tile pixel."""
    return 2.0 ** (BASE_LEVEL - level)


def canvas_from_level(level: int, edges: Array) -> Array:
    """Canvas places of pixel-edge coordinates of a level (pixel k lies between edges k and k + 1); any shape."""
    return edges * pixel_size(level) - HALF_SPAN - 0.5


def level_from_canvas(level: int, places: Array) -> Array:
    """Pixel-edge coordinates of canvas places; any shape. The inverse of `canvas_from_level`."""
    return (places + HALF_SPAN + 0.5) / pixel_size(level)


def tile_box(tile: Tile) -> Box:
    """The canvas box a tile covers."""
    edges = np.array([tile.x, tile.y, tile.x + 1, tile.y + 1], dtype=np.float64) * TILE_SIZE
    left, top, right, bottom = canvas_from_level(tile.z, edges).tolist()
    return left, top, right, bottom


def box_of(places: PointsNx2) -> Box | None:
    """Bounding box of points (n, 2), ignoring NaN; None if no point is left."""
    known = places[np.isfinite(places).all(axis=1)]
    if not len(known):
        return None
    (left, top), (right, bottom) = known.min(axis=0).tolist(), known.max(axis=0).tolist()
    return left, top, right, bottom


def join(a: Box, b: Box) -> Box:
    """Bounding box of two boxes."""
    return min(a[0], b[0]), min(a[1], b[1]), max(a[2], b[2]), max(a[3], b[3])


def tile_range(box: Box, level: int) -> tuple[Tile, Tile]:
    """The first and last tile (inclusive) that a box touches, clipped to the grid.

    A box that only touches an edge from outside counts as touching on its left and top, not on its right and bottom.
    """
    count = 1 << level
    left, top, right, bottom = level_from_canvas(level, np.array(box)) / TILE_SIZE
    first = Tile(level, *(min(max(math.floor(v), 0), count - 1) for v in (left, top)))
    last = Tile(level, *(min(max(math.ceil(v) - 1, 0), count - 1) for v in (right, bottom)))
    return first, Tile(level, max(first.x, last.x), max(first.y, last.y))


def tiles_over(box: Box, level: int) -> Iterator[Tile]:
    """Every tile of a level that a box touches, row by row."""
    first, last = tile_range(box, level)
    return (Tile(level, x, y) for y in range(first.y, last.y + 1) for x in range(first.x, last.x + 1))


def painting_level(gsd: float) -> int:
    """The coarsest level at which a frame with this ground sampling distance (canvas units per frame pixel) loses at most 20 % of
    its linear resolution; between level 0 and `FINEST_LEVEL`."""
    if not (math.isfinite(gsd) and gsd > 0):
        raise ValueError(f"a ground sampling distance is a positive number, not {gsd}")
    level = BASE_LEVEL - math.log2(gsd / (1 - RESOLUTION_LOSS))
    return min(max(math.ceil(level - 1e-9), 0), FINEST_LEVEL)


def level_among(gsd: float, usual: float) -> int:
    """Painting level of a frame among others whose level suits the ground sampling distance `usual`: theirs, if its own is
    similar. Frames on finer levels hide those on coarser ones, and people seen only there."""
    theirs, coarsest, finest = (painting_level(one) for one in (usual, gsd * SAME_HEIGHT, gsd / SAME_HEIGHT))
    return theirs if coarsest <= theirs <= finest else painting_level(gsd)


def overview_level(box: Box, finest: int) -> int:
    """The finest level, at most `finest`, at which a box fits into two by two tiles."""
    for level in range(finest, 0, -1):
        first, last = tile_range(box, level)
        if last.x - first.x <= 1 and last.y - first.y <= 1:
            return level
    return 0
