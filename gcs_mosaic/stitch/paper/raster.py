"""The mosaic as the paper has it: one picture that grows. Cut into tiles for whoever shows it.

Pixels of the mosaic are pixels of the first frame at the size it is stitched at, and pixels of one level of the tile grid.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.stitch.painting.grid import (
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
from gcs_mosaic.stitch.painting.painted import Extent
from gcs_mosaic.stitch.painting.stack import TilePicture

Image = NDArray[np.uint8]


class Window(NamedTuple):
    """Whole pixels of the mosaic, from left and top to before right and bottom; the first frame begins at (0, 0)."""

    left: int
    top: int
    right: int
    bottom: int

    @property
    def pixels(self) -> int:
        return max(0, self.right - self.left) * max(0, self.bottom - self.top)

    def joined(self, other: Window) -> Window:
        return Window(*(min(a, b) for a, b in zip(self[:2], other[:2], strict=True)), *map(max, self[2:], other[2:]))

    def cut(self, other: Window) -> Window:
        return Window(*(max(a, b) for a, b in zip(self[:2], other[:2], strict=True)), *map(min, self[2:], other[2:]))


class Raster:
    """A picture with coverage over one window of whole tiles, which `grow` enlarges. Empty at first."""

    def __init__(self, reduction: int) -> None:
        self.level = BASE_LEVEL - (reduction.bit_length() - 1)
        self.window = Window(0, 0, 0, 0)
        self._colour = np.zeros((0, 0, 3), np.uint8)
        self._coverage = np.zeros((0, 0), np.uint8)
        self._top = self.level  # the coarsest level that has been told of

    def window_with(self, added: Window) -> Window:
        """The window of whole tiles that would hold this as well."""
        outer = added if not self.window.pixels else self.window.joined(added)
        down = (TILE_SIZE * (value // TILE_SIZE) for value in outer[:2])
        up = (-TILE_SIZE * (-value // TILE_SIZE) for value in outer[2:])
        return Window(*down, *up)

    def grow(self, added: Window) -> None:
        """Make room for a window."""
        wanted = self.window_with(added)
        if wanted == self.window:
            return
        shape = wanted.bottom - wanted.top, wanted.right - wanted.left
        colour, coverage = np.zeros((*shape, 3), np.uint8), np.zeros(shape, np.uint8)
        left, top = self.window.left - wanted.left, self.window.top - wanted.top
        place = slice(top, top + len(self._colour)), slice(left, left + self._colour.shape[1])
        if self.window.pixels:
            colour[place], coverage[place] = self._colour, self._coverage
        self._colour, self._coverage, self.window = colour, coverage, wanted

    def part(self, window: Window) -> tuple[Image, Image]:
        """Colour (h, w, 3) and coverage (h, w), 0 or 255, of a window inside the mosaic's; to be written into."""
        y, x = self.window.top, self.window.left
        place = slice(window.top - y, window.bottom - y), slice(window.left - x, window.right - x)
        return self._colour[place], self._coverage[place]

    def tiles(self, changed: Window) -> set[Tile]:
        """Tiles of all levels that show any of a window, and those of levels that have come into use since the last call."""
        box, whole = self._canvas_box(changed), self._canvas_box(self.window)
        top = overview_level(whole, self.level)
        told = {tile for level in range(top, self.level + 1) for tile in tiles_over(box, level)}
        told |= {tile for level in range(top, self._top) for tile in tiles_over(whole, level)}
        self._top = min(top, self._top)
        return told

    def extent(self) -> Extent | None:
        """The canvas box of the mosaic and the levels it has tiles of; None while it is empty."""
        if not self.window.pixels:
            return None
        box = self._canvas_box(self.window)
        return Extent(box, overview_level(box, self.level), self.level)

    def tile(self, tile: Tile) -> TilePicture | None:
        """What a tile of the mosaic's level or a coarser one shows; None if nothing."""
        side = 1 << (self.level - tile.z)
        left, top = (i * TILE_SIZE * side - self._middle for i in (tile.x, tile.y))
        whole = Window(left, top, left + TILE_SIZE * side, top + TILE_SIZE * side)
        inner = whole.cut(self.window)
        if not inner.pixels:
            return None
        part_colour, part_coverage = self.part(inner)
        # The window is made of whole tiles of its level, so its edges are whole pixels of a tile up to 256 times coarser.
        size = (inner.right - inner.left) // side, (inner.bottom - inner.top) // side
        seen = cv2.resize(part_coverage, size, interpolation=cv2.INTER_AREA)
        if not seen.any():
            return None
        mean = cv2.resize(part_colour, size, interpolation=cv2.INTER_AREA).astype(np.float32)
        filled = np.where(
            seen[..., None] > 0, mean * (255 / np.maximum(seen, 1)[..., None]), 0
        )  # what is empty is black
        colour, coverage = np.zeros((TILE_SIZE, TILE_SIZE, 3), np.uint8), np.zeros((TILE_SIZE, TILE_SIZE), np.uint8)
        y, x = (inner.top - whole.top) // side, (inner.left - whole.left) // side
        colour[y : y + size[1], x : x + size[0]] = np.rint(filled).clip(0, 255)
        coverage[y : y + size[1], x : x + size[0]] = seen
        return TilePicture(colour, coverage)

    def _canvas_box(self, window: Window) -> Box:
        left, top, right, bottom = canvas_from_level(self.level, np.array(window) + float(self._middle)).tolist()
        return left, top, right, bottom

    @property
    def _middle(self) -> int:
        """The pixel of the level, across and down, at which the mosaic's (0, 0) lies."""
        return round(HALF_SPAN / pixel_size(self.level))
