"""What the painted frames have seen of an island, on a regular grid: how often, how finely, how lately; and where nobody has.

A frame counts where its real outline lies, not its bounding box. The grid of a whole island is made at most every few seconds
and kept; what is asked at a finer scale is made from the frames around, which are few.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.render.tile_grid import Box
from gcs_mosaic.stitch.arrays import Array, FloatImage, Mask
from gcs_mosaic.views.flight_view import FlightView, FrameTable

LONGER_SIDE = 1024  # cells of an island's grid at most
PER_FOOTPRINT = 24  # cells over a frame's median size, where that needs no more cells
REST = 20.0  # an island's grid is made again after so many times as much as that cost of a core, as in `flight_view`
LEAST_REST_S = 0.5
MOST_REST_S = 1.0  # whatever it cost: false gaps send an aircraft where it need not fly
FINER = 8  # outlines are filled at so many times the resolution: OpenCV fills what their lines touch, too
SUB_CELL_BITS = 4  # of polygon corners: a sixteenth of that
LEAST_GAP = 1 / 500  # of a footprint's area: smaller holes are told by the number of looks only
LEAST_BAY = 1 / 8  # of a footprint: narrower bays are no more than the zigzag of the border


@dataclass(frozen=True, slots=True)
class Grid:
    """Square cells over a canvas box: the corner of cell (0, 0), and the size of a cell in canvas units."""

    left: float
    top: float
    cell: float
    columns: int
    rows: int

    @classmethod
    def about(cls, x: float, y: float, side: float, cells: int) -> Grid:
        """A square about a place."""
        return cls(x - side / 2, y - side / 2, side / cells, cells, cells)

    @classmethod
    def over(cls, boxes: Array, finest: float, longer_side: int) -> Grid:
        """Over frames' boxes (n, 4) and a footprint around, of cells of `finest` canvas units, or of so many along the longer
        side. A frame that sees the horizon reaches any distance; what is seen there is worth nothing, and it must not spoil the
        grid."""
        (left, top), (right, bottom) = np.quantile(boxes[:, :2], 0.02, axis=0), np.quantile(boxes[:, 2:], 0.98, axis=0)
        around = footprint_of(boxes)
        left, top, right, bottom = (float(at) for at in (left - around, top - around, right + around, bottom + around))
        cell = max(finest, (right - left) / longer_side, (bottom - top) / longer_side)
        return cls(left, top, cell, int(np.ceil((right - left) / cell)), int(np.ceil((bottom - top) / cell)))

    @property
    def box(self) -> Box:
        return self.left, self.top, self.left + self.columns * self.cell, self.top + self.rows * self.cell

    def place_of(self, column: float, row: float) -> tuple[float, float]:
        """Canvas place of a cell's middle."""
        return self.left + (column + 0.5) * self.cell, self.top + (row + 0.5) * self.cell


@dataclass(frozen=True, slots=True)
class Coverage:
    """What was seen of each cell (rows, columns): the number of frames, the finest ground resolution (canvas units per pixel of
    the picture that was stitched; infinite where nobody looked), the newest time (seconds by one clock; NaN), the least angle
    from straight down (degrees; infinite), the least stated deviation (one standard deviation of a frame's worst corner, canvas
    units; infinite where that is not known), and the sharpest picture beside the others around (at most 1; NaN where that is
    not known)."""

    grid: Grid
    looks: NDArray[np.uint16]
    finest: FloatImage
    newest: Array
    steepest: FloatImage
    surest: FloatImage
    sharpest: FloatImage


@dataclass(frozen=True, slots=True)
class Gap:
    """Ground inside the flown area that no frame has seen."""

    outline: list[tuple[float, float]]  # canvas
    area: float  # canvas units squared
    inside: tuple[float, float]  # a point well within it


def seen_on(grid: Grid, table: FrameTable, frames: Iterable[int], taken: Array | None = None) -> Coverage:
    """What some frames (indices of the table) saw of a grid; `taken`: when each of the table's was, seconds, NaN if unknown."""
    looks = np.zeros((grid.rows, grid.columns), np.uint16)
    finest = np.full(looks.shape, np.inf, np.float32)
    newest = np.full(looks.shape, np.nan)
    steepest, surest, sharpest = finest.copy(), finest.copy(), np.full_like(finest, np.nan)
    for index in frames:
        found = cells_of(grid, table.outlines[index])
        if found is None:
            continue
        window, inside = found
        one = table.frames[index]
        looks[window][inside] += 1
        gsd = np.exp(one.pose.log_gsd)
        tilt = np.degrees(np.arccos(np.cos(one.pose.pitch) * np.cos(one.pose.roll)))
        deviation = np.inf if one.corner_deviation_px is None else one.corner_deviation_px * gsd
        for values, value in ((finest, gsd), (steepest, tilt), (surest, deviation)):
            values[window][inside] = np.minimum(values[window][inside], value)
        if taken is not None:
            newest[window][inside] = np.fmax(newest[window][inside], taken[index])
        sharpest[window][inside] = np.fmax(sharpest[window][inside], np.float32(table.sharpness[index]))
    return Coverage(grid, looks, finest, newest, steepest, surest, sharpest)


def gaps_in(coverage: Coverage, footprint: float) -> list[Gap]:
    """Holes and bays in what was seen that are narrower than a footprint (canvas units), the largest first.

    The flown area is the morphological closing of all that was seen by a disc of one footprint: what lies farther out was never
    meant to be flown, as far as the pictures tell.
    """
    cell = coverage.grid.cell
    flown = flown_area(coverage, footprint)
    bare = (flown & (coverage.looks == 0)).astype(np.uint8)
    count, labels, facts, _ = cv2.connectedComponentsWithStats(bare, connectivity=4)
    least = max(2, LEAST_GAP * (footprint / cell) ** 2)
    outside = cv2.dilate(np.pad(~flown, 1, constant_values=True).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    outside = outside[1:-1, 1:-1]
    large = (labels == k for k in range(1, count) if facts[k, cv2.CC_STAT_AREA] >= least)
    gaps = [
        _gap(coverage.grid, one)
        for one in large
        if not (one & outside).any() or _width(one) >= LEAST_BAY * footprint / cell
    ]
    return sorted(gaps, key=lambda gap: -gap.area)


def flown_area(coverage: Coverage, footprint: float) -> Mask:
    """The cells (rows, columns) of the flown area, as of `gaps_in`."""
    reach = max(1, round(footprint / coverage.grid.cell))
    seen = np.pad((coverage.looks > 0).astype(np.uint8), reach)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (reach | 1, reach | 1))
    return np.asarray(cv2.morphologyEx(seen, cv2.MORPH_CLOSE, disc)[reach:-reach, reach:-reach] > 0)


def footprint_of(boxes: Sequence[Array] | Array) -> float:
    """Median size of frames' bounding boxes (n, 4): the square root of their area, canvas units."""
    sizes = np.asarray(boxes)[:, 2:] - np.asarray(boxes)[:, :2]
    known = sizes[np.isfinite(sizes).all(axis=1)]
    return float(np.sqrt(np.median(known.prod(axis=1)))) if len(known) else 0.0


@dataclass(frozen=True, slots=True)
class SeenIsland:
    """What was seen of an island as of a revision of the map, and its gaps; `coverage` is None where nothing is painted."""

    revision: int
    coverage: Coverage | None
    gaps: list[Gap]


class IslandCoverage:
    """The whole islands of a flight, each kept until the map has changed and making it again costs little. Thread-safe."""

    def __init__(self, view: FlightView) -> None:
        self._view = view
        self._lock = threading.Lock()
        self._known: dict[int, tuple[float, SeenIsland]] = {}  # when to look again, in monotonic seconds

    def of(self, island: int, at_least: int = 0) -> SeenIsland:
        """An island as it was seen a second ago or later, and at a revision or later if the folder is there already."""
        with self._lock:  # never made twice at once
            table, known = self._view.table(at_least), self._known.get(island)
            if known is not None and known[1].revision == table.revision:
                return known[1]
            if known is not None and known[1].revision >= at_least and time.monotonic() < known[0]:
                return known[1]
            return self._made(table, island)

    def _made(self, table: FrameTable, island: int) -> SeenIsland:
        begun = time.thread_time()
        ours = np.flatnonzero((table.islands == island) & np.isfinite(table.boxes).all(axis=1))
        coverage, gaps = None, list[Gap]()
        if len(ours):
            footprint = footprint_of(table.boxes[ours])
            grid = Grid.over(table.boxes[ours], footprint / PER_FOOTPRINT, LONGER_SIDE)
            coverage = seen_on(grid, table, ours.tolist(), self._view.taken(table))
            gaps = gaps_in(coverage, footprint)
        rest = min(max(LEAST_REST_S, REST * (time.thread_time() - begun)), MOST_REST_S)
        made = SeenIsland(table.revision, coverage, gaps)
        if len(ours):  # else any number could be asked for and kept
            self._known[island] = time.monotonic() + rest, made
        return made


def nearest_cells(of: Grid, grid: Grid) -> tuple[Mask, tuple[NDArray[np.intp], ...]]:
    """For each cell of a grid (rows, columns): whether its middle lies in another one, and the nearest cell there."""
    columns = grid.left + (np.arange(grid.columns) + 0.5) * grid.cell
    rows = grid.top + (np.arange(grid.rows) + 0.5) * grid.cell
    across = np.floor((columns - of.left) / of.cell).astype(int)
    down = np.floor((rows - of.top) / of.cell).astype(int)
    known = ((down >= 0) & (down < of.rows))[:, None] & ((across >= 0) & (across < of.columns))
    return np.asarray(known), np.ix_(down.clip(0, of.rows - 1), across.clip(0, of.columns - 1))


def cells_of(grid: Grid, outline: Array) -> tuple[tuple[slice, slice], Mask] | None:
    """The cells whose middles lie within an outline (n, 2) on the canvas: a window of the grid, and which of it."""
    points = outline[np.isfinite(outline).all(axis=1)]
    if len(points) < 3:
        return None
    cells = (points - [grid.left, grid.top]) / grid.cell - 0.5  # the middle of the first cell is (0, 0)
    low = np.clip(np.floor(cells.min(axis=0)), 0, [grid.columns, grid.rows]).astype(int)
    high = np.clip(np.ceil(cells.max(axis=0)) + 1, 0, [grid.columns, grid.rows]).astype(int)
    if (low >= high).any():
        return None
    inside = np.zeros((FINER * (high[1] - low[1]), FINER * (high[0] - low[0])), np.uint8)
    size = 4.0 * max(inside.shape) + 64
    corners = np.clip(
        (cells - low) * FINER, -size, size
    )  # far corners of oblique frames; within the numbers that OpenCV takes
    fixed = np.rint(corners * (1 << SUB_CELL_BITS)).astype(np.int32)
    cv2.fillPoly(inside, [fixed], 1, shift=SUB_CELL_BITS)
    return np.s_[low[1] : high[1], low[0] : high[0]], inside[::FINER, ::FINER] > 0


def _gap(grid: Grid, cells: Mask) -> Gap:
    contours, _ = cv2.findContours(cells.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    longest = max(contours, key=cv2.contourArea)[:, 0]
    depth = _depth(cells)
    row, column = np.unravel_index(int(depth.argmax()), depth.shape)
    return Gap(
        outline=[grid.place_of(float(x), float(y)) for x, y in longest],
        area=float(cells.sum()) * grid.cell**2,
        inside=grid.place_of(float(column), float(row)),
    )


def _depth(cells: Mask) -> FloatImage:
    """Distance of each cell to the nearest that is not among them, in cells."""
    return np.asarray(cv2.distanceTransform(np.pad(cells.astype(np.uint8), 1), cv2.DIST_L2, 3)[1:-1, 1:-1], np.float32)


def _width(cells: Mask) -> float:
    return 2 * float(_depth(cells).max())
