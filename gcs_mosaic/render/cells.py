"""Which frame shows where: decided on cells of 8 tile px, by a fold over the frames in capture order, before any pixel is made.

For each cell the fold keeps the frame with the best view and the next best, so that a seam can still be moved (`seam_path`). It
is a function of the cell's frames alone, whatever else is decided at the same time, and vectorised over many tiles.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import cv2
import numpy as np

from gcs_mosaic.render.render_list import TileKey
from gcs_mosaic.render.tile_grid import TILE_SIZE, Tile
from gcs_mosaic.render.warp_grid import FrameLattice
from gcs_mosaic.stitch.arrays import AnyArray, CellFlags, FrameNumbers, Lattice, Mask, Planes, Share

CELL = 8  # tile px
CELLS = TILE_SIZE // CELL  # along a tile's side
NOBODY = -1  # in place of a frame's number
PARTLY, WHOLLY = 1, 2  # how far a frame covers a cell; 0: not at all
OPEN = 1.4  # log ratio: where one frame is at most four times better, the seam may be moved


@dataclass(frozen=True, slots=True, eq=False)
class Cells:
    """State of the fold for cells (h, w). `first`, `second`: numbers of the frame that shows and of the next best; `lead`: margin
    of the decision for the first, infinite without another; `score` of the first; `inside` (2, h, w): how far each covers the
    cell; `planes` (k, h, w): what the mode keeps of both."""

    first: FrameNumbers
    second: FrameNumbers
    lead: Lattice
    score: Lattice
    inside: Planes
    planes: Planes

    @property
    def arrays(self) -> tuple[AnyArray, ...]:
        return self.first, self.second, self.lead, self.score, self.inside, self.planes

    @property
    def nbytes(self) -> int:
        return sum(array.nbytes for array in self.arrays)


@dataclass(frozen=True, slots=True, eq=False)
class Owned:
    """Which frames the cells (h, w) show: `first` with its `share` (255: alone), `second` with the rest. If the first has all,
    the second shows where the first does not cover the cell; it is `NOBODY` where it does."""

    first: FrameNumbers
    second: FrameNumbers
    share: Share

    @property
    def arrays(self) -> tuple[AnyArray, ...]:
        return self.first, self.second, self.share

    @property
    def nbytes(self) -> int:
        return sum(array.nbytes for array in self.arrays)


T = TypeVar("T", Cells, Owned)


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """A new frame's contribution to cells (h, w): how far it covers them (`inside`), its score, and its planes (k, h, w)."""

    inside: CellFlags
    score: Lattice
    planes: Planes


class Window(NamedTuple):
    """A rectangle of tiles of one level of an island, inclusive of the last row and column."""

    island: int
    level: int
    top: int
    left: int
    bottom: int
    right: int

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of cells."""
        return (self.bottom - self.top + 1) * CELLS, (self.right - self.left + 1) * CELLS

    def place(self, key: TileKey, rim: int = 0) -> tuple[slice, slice]:
        """A tile's rows and columns of cells, with a margin of `rim`."""
        y, x = (key[1].y - self.top) * CELLS, (key[1].x - self.left) * CELLS
        return slice(y - rim, y + CELLS + rim), slice(x - rim, x + CELLS + rim)

    def wider(self) -> Window:
        """Extended by one tile on each side."""
        return self._replace(top=self.top - 1, left=self.left - 1, bottom=self.bottom + 1, right=self.right + 1)

    def above(self, levels: int) -> Window:
        """The window of tiles this many levels coarser that contains this one."""
        top, left, bottom, right = (edge >> levels for edge in (self.top, self.left, self.bottom, self.right))
        return Window(self.island, self.level - levels, top, left, bottom, right)

    def below(self, levels: int) -> Window:
        """The window of tiles this many levels finer that covers the same area."""
        top, left, bottom, right = self.top, self.left, self.bottom + 1, self.right + 1
        top, left, bottom, right = (edge << levels for edge in (top, left, bottom, right))
        return Window(self.island, self.level + levels, top, left, bottom - 1, right - 1)

    def part(self, y: int, x: int) -> Window:
        """Its tile at a row and a column, counted from 0."""
        return self._replace(top=self.top + y, bottom=self.top + y, left=self.left + x, right=self.left + x)

    def common(self, other: Window) -> Window | None:
        """Intersection with a window of the same level and island."""
        top, left = max(self.top, other.top), max(self.left, other.left)
        bottom, right = min(self.bottom, other.bottom), min(self.right, other.right)
        return (
            self._replace(top=top, left=left, bottom=bottom, right=right) if top <= bottom and left <= right else None
        )

    def of(self, other: Window) -> tuple[slice, slice]:
        """Rows and columns of cells of another window within this one."""
        (y, x), (height, width) = ((other.top - self.top) * CELLS, (other.left - self.left) * CELLS), other.shape
        return slice(y, y + height), slice(x, x + width)

    def tiles(self) -> Iterator[TileKey]:
        for y in range(self.top, self.bottom + 1):
            for x in range(self.left, self.right + 1):
                yield self.island, Tile(self.level, x, y)


def window_around(keys: Collection[TileKey]) -> Window:
    """The smallest window that contains these tiles, all of one level of one island."""
    (island, first), *_ = keys
    xs, ys = [tile.x for _, tile in keys], [tile.y for _, tile in keys]
    return Window(island, first.z, min(ys), min(xs), max(ys), max(xs))


def window_of(island: int, lattice: FrameLattice) -> Window:
    """The tiles that a frame's lattice spans."""
    first, last = lattice.first, lattice.last
    return Window(island, first.z, first.y, first.x, last.y, last.x)


def around(keys: Iterable[TileKey]) -> set[TileKey]:
    """These tiles and their eight neighbours."""
    return {
        (island, Tile(tile.z, tile.x + dx, tile.y + dy))
        for island, tile in keys
        for dy in (-1, 0, 1)
        for dx in (-1, 0, 1)
    }


def grouped(keys: Iterable[TileKey]) -> list[set[TileKey]]:
    """Tiles grouped by island and level."""
    groups: dict[tuple[int, int], set[TileKey]] = {}
    for key in keys:
        groups.setdefault((key[0], key[1].z), set()).add(key)
    return list(groups.values())


def in_blocks(keys: Collection[TileKey], side: int) -> list[set[TileKey]]:
    """Tiles of one level of an island in squares of so many tiles a side, row by row from their window's corner."""
    blocks: dict[tuple[int, int], set[TileKey]] = {}
    window = window_around(keys)
    for key in keys:
        at = (key[1].y - window.top) // side, (key[1].x - window.left) // side
        blocks.setdefault(at, set()).add(key)
    return [blocks[at] for at in sorted(blocks)]


def unknown(shape: tuple[int, int], planes: int) -> Cells:
    """Cells without any frame."""
    nobody = np.full(shape, NOBODY, np.int32)
    infinite, score = np.full(shape, np.inf, np.float32), np.zeros(shape, np.float32)
    return Cells(
        nobody, nobody.copy(), infinite, score, np.zeros((2, *shape), np.uint8), np.zeros((planes, *shape), np.uint8)
    )


def unowned(shape: tuple[int, int]) -> Owned:
    """Cells without an owner."""
    nobody = np.full(shape, NOBODY, np.int32)
    return Owned(nobody, nobody.copy(), np.full(shape, 255, np.uint8))


def view(whole: T, place: tuple[slice, slice]) -> T:
    """A part of these arrays, in the same memory."""
    return type(whole)(*[array[..., place[0], place[1]] for array in whole.arrays])


def part(whole: T, place: tuple[slice, slice]) -> T:
    """A copy of a part of these arrays."""
    return type(whole)(*[array.copy() for array in view(whole, place).arrays])


def put_together(whole: T, parts: Mapping[TileKey, T], window: Window) -> None:
    """Copy these tiles' values into `whole`."""
    for key, one in parts.items():
        rows, columns = window.place(key)
        for array, values in zip(whole.arrays, one.arrays, strict=True):
            array[..., rows, columns] = values


def alike(one: T, other: T) -> bool:
    """Whether all values are equal."""
    return all(np.array_equal(a, b) for a, b in zip(one.arrays, other.arrays, strict=True))


def touched(cells: Mask, window: Window) -> set[TileKey]:
    """The tiles of a window that contain any true cell (h, w)."""
    rows, columns = cells.shape[0] // CELLS, cells.shape[1] // CELLS
    tiles = cells.reshape(rows, CELLS, columns, CELLS).any(axis=(1, 3))
    return {
        (window.island, Tile(window.level, window.left + x, window.top + y)) for y, x in np.argwhere(tiles).tolist()
    }


def lay_over(cells: Cells, seen: Seen, number: int, decided: Lattice) -> tuple[Cells, Mask]:
    """One step of the fold: a frame over the present cells; `decided` is above 0 where it is to show instead of the first.

    Cells keep all planes of the first, and the last few of the second. Also returns which cells (h, w) have changed.
    """
    wins, follows = shares(cells, seen, decided)
    return laid(cells, seen, number, decided, wins, follows), wins | follows


def shares(cells: Cells, seen: Seen, decided: Lattice) -> tuple[Mask, Mask]:
    """Where (h, w) a frame becomes the first of the cells, and where the second."""
    wins = (seen.inside > 0) & ((cells.first == NOBODY) | (decided > 0))
    return wins, (seen.inside > 0) & ~wins & (-decided < cells.lead)


def laid(cells: Cells, seen: Seen, number: int, decided: Lattice, wins: Mask, follows: Mask) -> Cells:
    """The cells with a frame as their first where it `wins` (h, w), as their second where it `follows`."""
    after = Cells(*[array.copy() for array in cells.arrays])
    lay_in_place(after, seen, number, decided, wins, follows)
    return after


def lay_in_place(cells: Cells, seen: Seen, number: int, decided: Lattice, wins: Mask, follows: Mask) -> None:
    """As `laid`, in the given cells. What is kept of the second is written before it changes in the first."""
    known = cells.first != NOBODY
    decided = np.asarray(decided, np.float32)
    first, second, lead, score, inside, planes = cells.arrays
    of_all, of_both = len(seen.planes), len(planes) - len(seen.planes)
    numbers = np.full_like(first, number)
    _put(second, first, wins)
    _put(second, numbers, follows)
    _put(first, numbers, wins)
    _put(lead, np.where(known, decided, np.float32(np.inf)), wins)
    _put(lead, -decided, follows)
    _put(score, seen.score, wins)
    _put(inside[1], inside[0], wins)
    _put(inside[1], seen.inside, follows)
    _put(inside[0], seen.inside, wins)
    for k in range(of_all - of_both, of_all):
        _put(planes[k + of_both], planes[k], wins)
        _put(planes[k + of_both], seen.planes[k], follows)
    for k in range(of_all):
        _put(planes[k], seen.planes[k], wins)


def _put(there: AnyArray, values: AnyArray, where: Mask) -> None:
    """Overwrite where the mask is true, in place: same shape and type. Of bytes OpenCV does that ten times as fast as numpy."""
    cv2.copyTo(values, where.view(np.uint8), there)
