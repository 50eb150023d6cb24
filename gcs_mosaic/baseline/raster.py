"""The paper's mosaic: one growing image, cut into tiles for display.

Mosaic pixels are pixels of the first frame at stitching resolution, and pixels of one level of the tile grid.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import NamedTuple

import cv2
import numpy as np

from gcs_mosaic.render.pyramid import TilePicture
from gcs_mosaic.render.render_list import Extent
from gcs_mosaic.render.tile_grid import (
    BASE_LEVEL,
    HALF_SPAN,
    TILE_SIZE,
    Box,
    Tile,
    canvas_from_level,
    overview_level,
    pixel_size,
    tiles_over,
)
from gcs_mosaic.stitch.arrays import Coverage, FloatImage, ImageBGR
from gcs_mosaic.stitch.transaction import Kept

Place = tuple[slice, slice]  # rows, columns


class RasterBox(NamedTuple):
    """A half-open rectangle of mosaic pixels; the first frame begins at (0, 0)."""

    left: int
    top: int
    right: int
    bottom: int

    @property
    def pixels(self) -> int:
        return max(0, self.right - self.left) * max(0, self.bottom - self.top)

    def joined(self, other: RasterBox) -> RasterBox:
        return RasterBox(*(min(a, b) for a, b in zip(self[:2], other[:2], strict=True)), *map(max, self[2:], other[2:]))

    def cut(self, other: RasterBox) -> RasterBox:
        return RasterBox(*(max(a, b) for a, b in zip(self[:2], other[:2], strict=True)), *map(min, self[2:], other[2:]))


class Raster(Kept):
    """An image with coverage over one growing window of whole tiles. Initially empty."""

    def __init__(self, reduction: int) -> None:
        self.level = BASE_LEVEL - (reduction.bit_length() - 1)
        self.window = RasterBox(0, 0, 0, 0)
        # Colour and coverage of non-empty tiles, by left and top; replaced, never modified in place.
        self._tiles: dict[tuple[int, int], tuple[ImageBGR, Coverage]] = {}
        self._top = self.level  # the coarsest level reported so far

    def window_with(self, added: RasterBox) -> RasterBox:
        """The window of whole tiles extended to hold this one."""
        outer = added if not self.window.pixels else self.window.joined(added)
        down = (TILE_SIZE * (value // TILE_SIZE) for value in outer[:2])
        up = (-TILE_SIZE * (-value // TILE_SIZE) for value in outer[2:])
        return RasterBox(*down, *up)

    def part(self, window: RasterBox) -> tuple[ImageBGR, Coverage]:
        """Colour (h, w, 3) and coverage (h, w), 0 or 255, of a window; a copy, zero where the mosaic is empty."""
        shape = window.bottom - window.top, window.right - window.left
        colour, coverage = np.zeros((*shape, 3), np.uint8), np.zeros(shape, np.uint8)
        for corner in _corners(window):
            if corner in self._tiles:
                there, here = _shared(window, corner)
                colour[there], coverage[there] = (picture[here] for picture in self._tiles[corner])
        return colour, coverage

    def put(self, window: RasterBox, colour: ImageBGR, coverage: Coverage) -> None:
        """Replace the contents of a window; the mosaic grows as needed."""
        new = {}
        for corner in _corners(window):
            there, here = _shared(window, corner)
            old = self._tiles.get(corner, _EMPTY)
            pictures = old[0].copy(), old[1].copy()
            pictures[0][here], pictures[1][here] = colour[there], coverage[there]
            new[corner] = pictures
        self._tiles |= new
        self.window = self.window_with(window)

    def tiles(self, changed: RasterBox) -> set[Tile]:
        """Tiles of all levels that intersect a window, and those of levels first used since the last call."""
        box, whole = self._canvas_box(changed), self._canvas_box(self.window)
        top = overview_level(whole, self.level)
        told = {tile for level in range(top, self.level + 1) for tile in tiles_over(box, level)}
        told |= {tile for level in range(top, self._top) for tile in tiles_over(whole, level)}
        self._top = min(top, self._top)
        return told

    def extent(self) -> Extent | None:
        """Canvas box of the mosaic and its range of tile levels; None while empty."""
        if not self.window.pixels:
            return None
        box = self._canvas_box(self.window)
        return Extent(box, overview_level(box, self.level), self.level)

    def tile(self, tile: Tile) -> TilePicture | None:
        """A tile of the mosaic's level or a coarser one; None if empty."""
        side = 1 << (self.level - tile.z)
        left, top = (i * TILE_SIZE * side - self._middle for i in (tile.x, tile.y))
        whole = RasterBox(left, top, left + TILE_SIZE * side, top + TILE_SIZE * side)
        inner = whole.cut(self.window)
        if not inner.pixels:
            return None
        # The window consists of whole tiles of its level, so its edges are pixel edges of tiles up to 256 times coarser.
        mean, seen = self._reduced(inner, side)
        if not seen.any():
            return None
        # Uncovered pixels are black.
        filled = np.where(seen[..., None] > 0, mean * (255 / np.maximum(seen, 1)[..., None]), 0)
        colour, coverage = np.zeros((TILE_SIZE, TILE_SIZE, 3), np.uint8), np.zeros((TILE_SIZE, TILE_SIZE), np.uint8)
        y, x = (inner.top - whole.top) // side, (inner.left - whole.left) // side
        place = slice(y, y + seen.shape[0]), slice(x, x + seen.shape[1])
        colour[place], coverage[place] = np.rint(filled).clip(0, 255), seen
        return TilePicture(colour, coverage)

    def _reduced(self, window: RasterBox, side: int) -> tuple[FloatImage, Coverage]:
        """Mean colour and coverage of each `side` by `side` pixels of a window of whole tiles."""
        size = TILE_SIZE // side
        shape = (window.bottom - window.top) // side, (window.right - window.left) // side
        mean, seen = np.zeros((*shape, 3), np.float32), np.zeros(shape, np.uint8)
        for left, top in _corners(window):
            if (left, top) in self._tiles:
                y, x = (top - window.top) // side, (left - window.left) // side
                place = slice(y, y + size), slice(x, x + size)
                mean[place], seen[place] = (
                    cv2.resize(picture, (size, size), interpolation=cv2.INTER_AREA)
                    for picture in self._tiles[left, top]
                )
        return mean, seen

    def _canvas_box(self, window: RasterBox) -> Box:
        left, top, right, bottom = canvas_from_level(self.level, np.array(window) + float(self._middle)).tolist()
        return left, top, right, bottom

    @property
    def _middle(self) -> int:
        """The pixel of the level, in x and y, at which the mosaic's (0, 0) lies."""
        return round(HALF_SPAN / pixel_size(self.level))


_EMPTY = np.zeros((TILE_SIZE, TILE_SIZE, 3), np.uint8), np.zeros((TILE_SIZE, TILE_SIZE), np.uint8)


def _corners(window: RasterBox) -> Iterator[tuple[int, int]]:
    """Left and top of the tiles that a window touches."""
    left, top = (TILE_SIZE * (value // TILE_SIZE) for value in window[:2])
    return product(range(left, window.right, TILE_SIZE), range(top, window.bottom, TILE_SIZE))


def _shared(window: RasterBox, corner: tuple[int, int]) -> tuple[Place, Place]:
    """Intersection of a window and a tile, as slices of the window and of the tile."""
    tile = RasterBox(*corner, corner[0] + TILE_SIZE, corner[1] + TILE_SIZE)
    both = tile.cut(window)
    there, here = (
        (slice(both.top - of.top, both.bottom - of.top), slice(both.left - of.left, both.right - of.left))
        for of in (window, tile)
    )
    return there, here
