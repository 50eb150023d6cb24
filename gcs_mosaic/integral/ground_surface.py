"""The ground's height beneath trees all over an island: sought in each cell of a grid by itself, and smooth in between."""

from __future__ import annotations

import math
import time
from collections import OrderedDict
from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from gcs_mosaic.integral.aperture import aperture_of
from gcs_mosaic.integral.flight_looks import HIGHEST, LOWEST, as_grey, read_look, spread
from gcs_mosaic.integral.focal_plane import camera_height
from gcs_mosaic.integral.focus import CELLS, LEAST_LOOKS, MOST_LOOKS, Focus, ground_focus
from gcs_mosaic.integral.ground_lens import GroundLens
from gcs_mosaic.integral.relief_plane import slopes_of
from gcs_mosaic.integral.stack import GroundLook, GroundWindow
from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.render.tile_grid import Box
from gcs_mosaic.stitch.arrays import Array, Mask, PointsNx2, Vector
from gcs_mosaic.views.flight_view import FlightView, FrameTable, pixels_of

# Cells along the shorter side of a usual frame, about: half of it is what a lens on the page is wide of, from 80 m up.
IN_A_FRAME = 2
# Of a place: where the ground is sought that is not found there, and how many that know it tell it, and are enough.
CELLS_AROUND, LEAST_CELLS, ENOUGH_CELLS = 2, 2, 3
NEAR_GUESS = 0.02  # of the flying height, by which ground that was found may lie above what is seen beside it
KEPT_LOOKS = 256  # coarse ones, of all of a frame: 100 KB each
KEPT_CELLS = 4096

Made = TypeVar("Made")
Slowly = Generator[
    None, None, Made
]  # what is made in pieces, so that whoever has it made can rest, or give it up, in between


@dataclass(frozen=True, slots=True)
class GroundCell:
    """`height`: of the focus, as a share of `flying_height` (canvas units; NaN where nobody has been), above the map's ground."""

    height: float
    is_known: bool
    flying_height: float

    @property
    def is_guess(self) -> bool:
        """Whether something is seen at its height, though that may be leaves above the ground; at 0 nothing is."""
        return not self.is_known and self.height != 0 and math.isfinite(self.flying_height)


@dataclass(frozen=True, slots=True, eq=False)
class GroundHeights:
    """Heights of the focus (rows, columns) in canvas units at the middles of cells `size` wide, the first of them at `left`,
    `top`. `known`: in how many of the cells that lie on a box the ground was found, `cells`: of how many."""

    left: float
    top: float
    size: float
    grid: Array
    known: int
    cells: int

    def at(self, places: PointsNx2) -> Vector:
        """Heights (n,) at canvas places (n, 2), bilinear; beyond the grid those of its border."""
        rows, columns = self.grid.shape
        across = np.clip((places[:, 0] - self.left) / self.size, 0, columns - 1)
        down = np.clip((places[:, 1] - self.top) / self.size, 0, rows - 1)
        column, row = (np.minimum(one.astype(int), most) for one, most in ((across, columns - 2), (down, rows - 2)))
        right, below = across - column, down - row
        upper = self.grid[row, column] * (1 - right) + self.grid[row, column + 1] * right
        lower = self.grid[row + 1, column] * (1 - right) + self.grid[row + 1, column + 1] * right
        return np.asarray(upper * (1 - below) + lower * below)


class GroundSurface:
    """For one thread. Keeps cells as long as the frames that see them lie as they did, and coarse looks."""

    def __init__(self, view: FlightView) -> None:
        self._view = view
        self._cells: OrderedDict[tuple[int, float, int, int], tuple[int, GroundCell]] = OrderedDict()
        self._looks: OrderedDict[tuple[int, float], tuple[RenderItem, GroundLook | None]] = OrderedDict()

    def over(self, island: int, box: Box, height: float | None) -> Slowly[GroundHeights]:
        """Over a canvas box. `height`: a share of the flying height to be kept everywhere; None: it is sought, in the box and a
        cell around it, and each cell has the middle one of what was found in it and beside it."""
        table = self._view.table()
        size = cell_size(table, island)
        first, last = (np.floor(np.array(corner) / size - 0.5).astype(int) for corner in (box[:2], box[2:]))
        first, last = first - 1, last + 2  # for what lies between the middles of cells; and one around
        rows = list[list[GroundCell]]()
        for row in range(int(first[1]), int(last[1]) + 1):
            found = []
            for column in range(int(first[0]), int(last[0]) + 1):
                found.append((yield from self._cell(table, island, size, (column, row), height)))
            rows.append(found)
        grid, known = _smooth(rows)
        left, top = ((first + 1.5) * size).tolist()
        seen = np.array([[math.isfinite(one.flying_height) for one in row] for row in rows])[1:-1, 1:-1]
        return GroundHeights(left, top, size, grid, int((known & seen).sum()), int(seen.sum()))

    def focus_of(self, island: int, lens: GroundLens, within_s: float) -> Focus:
        """Where a lens sees the ground; where it does not, the middle one of the heights found around it, the nearest first, if
        some are known or found within some seconds."""
        own = lens.focus()
        if own.known:
            return own
        until = time.monotonic() + within_s
        known, guesses = list[float](), list[float]()
        for cell in self._around(island, lens.middle):
            if cell is not None and (cell.is_known or cell.is_guess):
                (known if cell.is_known else guesses).append(cell.height * cell.flying_height / lens.flying_height)
            if len(known) == ENOUGH_CELLS or time.monotonic() > until:
                break
        if len(known) < LEAST_CELLS or not _are_lowest(np.array(known), np.array(guesses)):
            return own
        return replace(own, height=float(np.clip(np.median(known), LOWEST, HIGHEST)), beside=True)

    def _around(self, island: int, place: Vector) -> Generator[GroundCell | None, None, None]:
        """The cells about a place, the nearest first; None while one is in the making."""
        table = self._view.table()
        size = cell_size(table, island)
        column, row = np.floor(place / size).astype(int).tolist()
        near = range(-CELLS_AROUND, CELLS_AROUND + 1)
        cells = [(column + right, row + below) for right in near for below in near]
        for at in sorted(cells, key=lambda one: float(np.hypot(*((np.array(one) + 0.5) * size - place)))):
            making = self._cell(table, island, size, at, None)
            while True:
                try:
                    next(making)
                except StopIteration as made:
                    yield made.value
                    break
                yield None

    def forget(self) -> None:
        """Let go of looks; what was found is kept."""
        self._looks.clear()

    def _cell(
        self, table: FrameTable, island: int, size: float, at: tuple[int, int], height: float | None
    ) -> Slowly[GroundCell]:
        x, y = (at[0] + 0.5) * size, (at[1] + 0.5) * size
        near = [table.frames[index] for index in table.near(island, (x, y, x, y))]
        flying = float(np.median([camera_height(one.pose, one.camera) for one in near])) if near else math.nan
        if height is not None or len(near) < LEAST_LOOKS:
            return GroundCell(height or 0.0, height is not None, flying)
        painted = {one.number: found for one in near if (found := self._view.painted(one.number)) is not None}
        shows = hash(tuple(painted.items()))
        kept = self._cells.get((island, size, *at))
        if kept is None or kept[0] != shows:
            kept = shows, (yield from self._sought(painted, GroundWindow(x, y, size, CELLS), flying))
            self._cells[island, size, *at] = kept
            while len(self._cells) > KEPT_CELLS:
                self._cells.popitem(last=False)
        return kept[1]

    def _sought(self, painted: dict[int, RenderItem], window: GroundWindow, flying: float) -> Slowly[GroundCell]:
        middle = np.array([window.x, window.y])
        seeing = {number: one for number, one in painted.items() if _sees(one, middle)}
        looks = list[GroundLook]()
        for number in spread(list(seeing), MOST_LOOKS):
            look = self._coarse(number, seeing[number], window.cell)
            if look is not None:
                looks.append(look)
            yield
        if len(looks) < LEAST_LOOKS:
            return GroundCell(0.0, False, flying)
        focus = ground_focus(looks, window, flying, aperture_of(looks, middle, 0.0))
        yield
        return GroundCell(focus.height, focus.known, flying)

    def _coarse(self, number: int, painted: RenderItem, cell: float) -> GroundLook | None:
        """All of a frame, no finer than cells."""
        kept = self._looks.get((number, cell))
        if kept is None or kept[0] != painted:
            kept = painted, _whole(self._view, number, painted, cell)
            self._looks[number, cell] = kept
            while len(self._looks) > KEPT_LOOKS:
                self._looks.popitem(last=False)
        self._looks.move_to_end((number, cell))
        return kept[1]


def cell_size(table: FrameTable, island: int) -> float:
    """Canvas units, a power of two: it stays the same while an island grows."""
    sides = [
        math.exp(one.pose.log_gsd) * min(one.camera.width, one.camera.height)
        for one, its in zip(table.frames, table.islands.tolist(), strict=True)
        if its == island
    ]
    return 2.0 ** round(math.log2(float(np.median(sides)) / IN_A_FRAME)) if sides else 1.0


def sloped(painted: RenderItem) -> RenderItem:
    """As a frame lies on the map's ground without its crowns, see `slopes_of`."""
    return replace(painted, relief=slopes_of(painted.relief, painted.camera))


def _whole(view: FlightView, number: int, painted: RenderItem, cell: float) -> GroundLook | None:
    ground = sloped(painted)
    wide = 2 * math.exp(painted.pose.log_gsd) * math.hypot(painted.camera.width, painted.camera.height)
    window = GroundWindow(painted.pose.x, painted.pose.y, wide, max(1, round(wide / cell)))
    look = read_look(view, number, ground, window, (0.0, 0.0))
    return None if look is None else replace(as_grey(look), relief=ground.relief)


def _sees(painted: RenderItem, place: Vector) -> bool:
    x, y = pixels_of(painted, place[None])[0].tolist()
    (left, top), (right, bottom) = painted.dead.limits(painted.camera.width, painted.camera.height)
    return bool(left < x < right and top < y < bottom)  # NaN is outside too


def _smooth(rows: Sequence[Sequence[GroundCell]]) -> tuple[Array, Mask]:
    """Of cells (rows, columns) the heights in canvas units without the outermost; and which of these are known."""
    shares = np.array([[one.height for one in row] for row in rows])
    known = np.array([[one.is_known for one in row] for row in rows])
    is_guess = np.array([[one.is_guess for one in row] for row in rows])
    flying = np.array([[one.flying_height for one in row] for row in rows])
    is_seen = np.isfinite(flying)
    flying = np.where(is_seen, flying, float(np.median(flying[is_seen])) if is_seen.any() else 0.0)
    found = np.zeros((len(rows) - 2, len(rows[0]) - 2))
    is_found = np.zeros(found.shape, bool)
    for row, column in np.ndindex(*found.shape):
        around = np.s_[row : row + 3, column : column + 3]
        guessed = is_guess[around]
        is_found[row, column] = _are_lowest(shares[around][known[around]], shares[around][guessed])
        some = shares[around][known[around] if is_found[row, column] else is_seen[around]]
        found[row, column] = float(np.median(some)) * flying[row + 1, column + 1] if some.size else 0.0
    return found, is_found


def _are_lowest(known: Array, guesses: Array) -> bool:
    """Whether heights (n,) at which ground was found are no higher than most of what is seen lowest beside it (m,): nothing is to
    be seen below the ground, so that else they are of crowns."""
    if not known.size:
        return False
    return not guesses.size or bool(np.median(known) <= np.median(guesses) + NEAR_GUESS)
