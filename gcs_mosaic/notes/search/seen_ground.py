"""Which ground of an island is painted, in the cells of the reviews, and with which frames."""

from __future__ import annotations

import math
import threading
from collections import OrderedDict
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.notes.storage.checked import Unfit
from gcs_mosaic.render.tile_grid import HALF_SPAN, Box
from gcs_mosaic.stitch.arrays import Array, Mask
from gcs_mosaic.views.coverage import footprint_of
from gcs_mosaic.views.flight_view import FrameTable

CELL_LEVEL = 17  # a cell is a tile of this level: 128 canvas units, an eighth of a small frame
CELL = 128.0  # canvas units
MOST_ASKED = 1 << 18  # cells of one question
MOST_GROUND = 1 << 22  # cells of an island's box: 2048 each way, 250 small frames side by side
KEPT_ISLANDS = 4  # of 32 MB each at most
# Footprints from the middle of a frame's outline: further away a frame that sees the horizon shows nothing that can be searched.
REACH = 3.0
COUNT = 1 << 32  # a stamp is so many times the number of frames, and the number of the newest
NUMBERS = COUNT - 1
SUB_CELL_BITS = 8
FARTHEST = 1 << 30  # of what OpenCV takes
Stamps = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class StampedGround:
    """Cells from (x, y) on. `stamps` (lines, columns) int64: how many frames cover or touch a cell, and the number of the newest
    of them; 0 where nothing is painted. `is_cut`: of a whole island some is painted beyond these cells."""

    x: int
    y: int
    stamps: Stamps
    is_cut: bool = False

    @property
    def box(self) -> Box:
        """On the island's canvas."""
        left, top = self.x * CELL - HALF_SPAN, self.y * CELL - HALF_SPAN
        lines, columns = self.stamps.shape
        return left, top, left + columns * CELL, top + lines * CELL

    def within(self, cells: set[tuple[int, int]]) -> dict[tuple[int, int], int]:
        """The stamps of those of some cells that are painted."""
        lines, columns = self.stamps.shape
        known = [(x, y) for x, y in cells if 0 <= x - self.x < columns and 0 <= y - self.y < lines]
        return {(x, y): stamp for x, y in known if (stamp := int(self.stamps[y - self.y, x - self.x]))}


NOTHING = StampedGround(0, 0, np.zeros((0, 0), np.int64))


def is_as_seen(looked: Stamps, now: Stamps) -> Mask:
    """Whether no frame has come to cells (n,) since they had the stamps `looked`: neither a newer one nor, placed late, an older
    one. Of looks from before frames were counted only the newest is known."""
    is_newest = (looked & NUMBERS) >= (now & NUMBERS)
    return np.asarray(is_newest & ((looked < COUNT) | (looked // COUNT >= now // COUNT)))


def spans(box: Box) -> tuple[range, range]:
    """Columns and lines of the cells that a canvas box touches; at least one of each."""
    left, top, right, bottom = ((edge + HALF_SPAN) / CELL for edge in box)
    columns = range(math.floor(left), max(math.ceil(right), math.floor(left) + 1))
    return columns, range(math.floor(top), max(math.ceil(bottom), math.floor(top) + 1))


def ground_within(
    table: FrameTable, island: int, box: Box, known_at: float = math.inf, most: int = MOST_ASKED
) -> StampedGround:
    """The ground within a canvas box, of those frames that were known at `known_at` (monotonic seconds). Raises Unfit for too
    large a box."""
    columns, lines = spans(box)
    if len(columns) * len(lines) > most:
        raise Unfit(f"The box has more than {most} cells: ask for a smaller one.")
    count = np.zeros((len(lines), len(columns)), np.int64)
    newest = np.zeros_like(count)
    for index in table.near(island, box):
        cells = (table.outlines[index] + HALF_SPAN) / CELL - 0.5 - (columns[0], lines[0])
        if table.since[index] <= known_at and (found := _touched(cells, *count.shape)):
            window, touched = found
            count[window] += touched
            newest[window] = np.maximum(newest[window], touched * table.frames[index].number)
    return StampedGround(columns[0], lines[0], count * COUNT + newest)


def seen_cells(table: FrameTable, island: int, box: Box, known_at: float = math.inf) -> dict[tuple[int, int], int]:
    """The painted cells within a canvas box, with their stamps; as `ground_within`."""
    ground = ground_within(table, island, box, known_at)
    lines, columns = np.nonzero(ground.stamps)
    stamps = ground.stamps[lines, columns].tolist()
    return dict(zip(zip((columns + ground.x).tolist(), (lines + ground.y).tolist(), strict=True), stamps, strict=True))


def island_box(table: FrameTable, island: int) -> Box | None:
    """Around what an island's frames show less than `REACH` footprints away; of an island beyond all bounds the middle. None
    where nothing is painted."""
    ours = np.flatnonzero((table.islands == island) & np.isfinite(table.boxes).all(axis=1))
    if not len(ours):
        return None
    boxes, reach = table.boxes[ours], REACH * footprint_of(table.boxes[ours])
    middles = np.nanmedian(table.outlines[ours], axis=1)
    low = np.maximum(boxes[:, :2], middles - reach).min(axis=0)
    high = np.minimum(boxes[:, 2:], middles + reach).max(axis=0)
    half = CELL * (math.isqrt(MOST_GROUND) // 2 - 1)
    middle = np.median(middles, axis=0)
    left, top = np.maximum(low, middle - half).tolist()
    right, bottom = np.minimum(high, middle + half).tolist()
    return left, top, right, bottom


def is_cut_by(table: FrameTable, island: int, box: Box) -> bool:
    """Whether any frame of an island shows ground beyond a box."""
    boxes = table.boxes[(table.islands == island) & np.isfinite(table.boxes).all(axis=1)]
    return bool((boxes[:, :2] < box[:2]).any() or (boxes[:, 2:] > box[2:]).any())


class IslandGround:
    """The whole islands of a flight, those that were asked for last kept until another frame is known. Thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._known: OrderedDict[int, tuple[FrameTable, int, StampedGround]] = OrderedDict()

    def of(self, table: FrameTable, island: int, known_at: float) -> StampedGround:
        """As `ground_within`, of the island's whole box."""
        count = int((table.since <= known_at).sum())
        with self._lock:  # never made twice at once
            known = self._known.get(island)
            if known is not None and known[0] is table and known[1] == count:
                self._known.move_to_end(island)
                return known[2]
            box = island_box(table, island)
            if box is None:  # any number may be asked for: only what there is is kept
                return NOTHING
            made = ground_within(table, island, box, known_at, MOST_GROUND)
            made = replace(made, is_cut=is_cut_by(table, island, box))
            self._known[island] = table, count, made
            self._known.move_to_end(island)
            while len(self._known) > KEPT_ISLANDS:
                self._known.popitem(last=False)
            return made


def _touched(corners: Array, lines: int, columns: int) -> tuple[tuple[slice, slice], Mask] | None:
    """The cells that an outline (n, 2) touches, in cells: a window, and which of it. What lies above the horizon is cut off
    along the line between the last points that are seen."""
    points = corners[np.isfinite(corners).all(axis=1)]
    if len(points) < 3:
        return None
    low = np.clip(np.floor(points.min(axis=0)) - 1, 0, [columns, lines]).astype(int)
    high = np.clip(np.ceil(points.max(axis=0)) + 2, 0, [columns, lines]).astype(int)
    if (low >= high).any():
        return None
    inside = np.zeros((high[1] - low[1], high[0] - low[0]), np.uint8)
    fixed = np.rint((points - low) * (1 << SUB_CELL_BITS)).clip(-FARTHEST, FARTHEST).astype(np.int32)
    cv2.fillPoly(inside, [fixed], 1, shift=SUB_CELL_BITS)
    return np.s_[low[1] : high[1], low[0] : high[0]], inside > 0
