"""What changed between the flights of a merged map: each flight's picture of the ground, compared cell by cell.

Made while somebody asks, some frames with each question. Things that stand up lean otherwise in another flight, and shadows move
with the sun: it shows where the pictures differ, and not why.
"""

from __future__ import annotations

import json
import logging
import threading
import time
from collections import OrderedDict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np

from gcs_mosaic.errors import UsageError
from gcs_mosaic.stitch.arrays import AnyImage, Counts, FloatImage, Mask
from gcs_mosaic.store import inside
from gcs_mosaic.store.folder import PROGRESS_NAME
from gcs_mosaic.views.coverage import Grid, footprint_of
from gcs_mosaic.views.even_light import MISPLACED, beyond, usual_deviation
from gcs_mosaic.views.flight_view import FlightView, FrameTable
from gcs_mosaic.views.ground_window import OnGround, flat_picture, laid
from gcs_mosaic.views.pictures import NoPicture

logger = logging.getLogger(__name__)

LONGER_SIDE = 3000  # cells of an island at most: two pictures of it take 50 MB
FINEST = 2.0  # pixels of a usual frame that a cell is wide at least
# Cells of which the local mean is taken, see `flattened`: changes may be as large as a car, or a small house.
AROUND = 32.0
# And no more of a usual frame's side: over a wide map cells are coarse, and a frame has few.
MOST_AROUND = 1 / 8
RIM = (
    1.5  # such deviations from a frame's border within which it is not compared: the mean is one of one side only there
)
LEAST_CONTRAST = 0.15  # logarithm: so much brighter or darker than all that the other flight shows within MISPLACED
NOISES = 4.0  # times the usual difference, where that is more
LEAST_CELLS = 3
MOST_AREAS = 200
BAND = 512  # rows compared at a time
SAMPLE = 97  # every so manieth cell tells the usual difference
WORK_S = 1.0  # for each question; a frame that was begun is finished
RETRY_S = 10.0  # until a frame is tried again that could not be shown for a moment
KEPT_ISLANDS = 2  # of 72 MB at most each while they are compared, and 45 afterwards
MOST_BYTES = 1 << 16


@dataclass(frozen=True, slots=True)
class ChangedArea:
    """Canvas place of its middle, its area in canvas units squared, and how much brighter the later flight is (logarithm)."""

    x: float
    y: float
    area: float
    contrast: float


@dataclass(frozen=True, slots=True)
class Compared:
    """`strength`: how much an island's cells changed, in logarithms, positive where the later flight is brighter, 0 where nothing
    is known to have changed; None while frames are left to be compared. `unknown`: cells that were seen and are not compared, by
    one flight alone or near the borders of frames. `unshown`: frames that cannot be shown, so that they are not compared."""

    revision: int
    done: int
    frames: int
    window: Grid | None = None
    strength: FloatImage | None = None
    unknown: Mask | None = None
    share: float = 0.0  # of the ground that was seen, which is compared
    unshown: int = 0
    areas: Sequence[ChangedArea] = ()


@dataclass(slots=True)
class _Island:
    """Being compared: each flight's picture so far, and how deep within a frame each of its cells lies."""

    revision: int
    window: Grid
    around: float  # cells of the local mean
    left: list[tuple[int, int]]  # flight (0 earlier, 1 later), number of the frame
    frames: int
    pictures: list[AnyImage]  # float16
    depths: list[AnyImage]  # uint16, cells
    again: dict[int, float] = field(default_factory=dict)  # when to try a frame, in monotonic seconds
    unshown: int = 0
    found: Compared | None = field(default=None)


def merged_flights(view: FlightView, table: FrameTable) -> tuple[list[str], dict[int, int]]:
    """Names of the flights that were merged, in order of time, and which of them took each frame by its number; empty if the map
    is not one of several flights."""
    if not _was_merged(view.root):
        return [], {}
    of = {one.number: one.name.split("/", 1)[0] for one in table.frames}
    taken = view.taken(table)
    times: dict[str, list[float]] = {}
    for one, at in zip(table.frames, taken.tolist(), strict=True):
        times.setdefault(of[one.number], []).append(at)
    names = sorted(times, key=lambda name: (_middle(times[name]), name))
    return (names, {number: names.index(name) for number, name in of.items()}) if len(names) > 1 else ([], {})


class FlightChanges:
    """Of one flight's folder: the last of the merged flights is compared with all before it. Thread-safe."""

    def __init__(self, view: FlightView) -> None:
        self._view = view
        self._lock = threading.Lock()
        self._islands: OrderedDict[int, _Island] = OrderedDict()  # the one that was asked for last at the end

    def ask(self, island: int, work_s: float = WORK_S) -> Compared:
        """What is known of an island after some seconds of further work; at once while another's question is worked on."""
        if not self._lock.acquire(blocking=False):
            return self._so_far(island)
        try:
            table = self._view.table()
            one = self._begun(island, table)
            if one is None:
                return Compared(table.revision, 0, 0)
            self._work(one, time.monotonic() + work_s)
            if not one.left and one.found is None:
                one.found = _compared(one)
                one.pictures, one.depths = [], []
            return _told(one)
        finally:
            self._lock.release()

    def known(self, island: int) -> Compared | None:
        """What has been compared whole; None before."""
        known = self._islands.get(island)
        return None if known is None else known.found

    def _so_far(self, island: int) -> Compared:
        """Without waiting for who works."""
        known = self._islands.get(island)
        if known is not None:
            return _told(known)
        table = self._view.table()
        frames = int(_indices_of(island, table).size) if merged_flights(self._view, table)[0] else 0
        return Compared(table.revision, 0, frames)

    def _begun(self, island: int, table: FrameTable) -> _Island | None:
        known = self._islands.get(island)
        if known is not None and known.revision == table.revision:
            self._islands.move_to_end(island)
            return known
        names, of = merged_flights(self._view, table)
        ours = _indices_of(island, table)
        if not names or not len(ours):
            return None
        gsd = float(np.median([np.exp(table.frames[int(index)].pose.log_gsd) for index in ours]))
        window = Grid.over(table.boxes[ours], FINEST * gsd, LONGER_SIDE)
        around = min(AROUND, MOST_AROUND * footprint_of(table.boxes[ours]) / window.cell)
        numbers = [table.frames[int(index)].number for index in ours]
        left = [(int(of[number] == len(names) - 1), number) for number in numbers]
        shape = window.rows, window.columns
        pictures = [np.zeros(shape, np.float16) for _ in range(2)]
        depths = [np.zeros(shape, np.uint16) for _ in range(2)]
        begun = _Island(table.revision, window, around, left, len(left), pictures, depths)
        self._islands[island] = begun
        self._islands.move_to_end(island)
        while len(self._islands) > KEPT_ISLANDS:
            self._islands.popitem(last=False)
        return begun

    def _work(self, one: _Island, end: float) -> None:
        """Add frames. One stays to be added until it was, or never can be; raises UsageError while the ledger cannot be read."""
        while time.monotonic() < end and (turn := _due(one)) is not None:
            flight, number = one.left[turn]
            try:
                is_shown = self._add(one, flight, number)
            except UsageError:
                raise
            except NoPicture as reason:
                logger.info("frame %d is compared later with another flight: %s", number, reason)
                one.again[number] = time.monotonic() + RETRY_S
                continue
            except Exception:
                logger.exception("frame %d cannot be compared with another flight", number)
                is_shown = False
            one.unshown += not is_shown
            del one.left[turn]

    def _add(self, one: _Island, flight: int, number: int) -> bool:
        """Lay a frame on its flight's picture, where no other frame has a place deeper within it; False if it cannot be shown.
        Raises NoPicture where that passes."""
        painted = self._view.painted(number)
        box = None if painted is None else _rows_columns(one.window, self._view.table(), number)
        if painted is None or box is None:
            return True
        (top, bottom), (left, right) = box
        part = Grid(*_corner(one.window, left, top), one.window.cell, right - left, bottom - top)
        flat = flat_picture(self._view, number, OnGround(painted), part, one.around)
        if flat is None:
            return False
        shown, seen = laid(OnGround(painted), flat[..., None], part)
        depth = cv2.distanceTransform(np.pad(seen.astype(np.uint8), 1), cv2.DIST_L2, 3)[1:-1, 1:-1]
        there = np.s_[top:bottom, left:right]
        better = depth > one.depths[flight][there]
        one.depths[flight][there][better] = np.minimum(np.ceil(depth[better]), 65535).astype(np.uint16)
        one.pictures[flight][there][better] = shown[..., 0][better]
        return True


def _due(one: _Island) -> int | None:
    """Which of the frames that are left comes next; None while none does."""
    now = time.monotonic()
    return next((turn for turn, (_, number) in enumerate(one.left) if now >= one.again.get(number, now)), None)


def _middle(times: Sequence[float]) -> float:
    """The median of those that are known; before all others if none is."""
    known = [at for at in times if np.isfinite(at)]
    return float(np.median(known)) if known else -np.inf


def _told(one: _Island) -> Compared:
    if one.found is not None:
        return one.found
    done = one.frames - max(1, len(one.left))  # all are done only as soon as the changes are told with it
    return Compared(one.revision, done, one.frames)


def _indices_of(island: int, table: FrameTable) -> Counts:
    """An island's frames that see some ground, in a table."""
    return np.flatnonzero((table.islands == island) & np.isfinite(table.boxes).all(axis=1))


def _compared(one: _Island) -> Compared:
    both = np.minimum(*one.depths) > RIM * one.around
    is_seen = np.maximum(*one.depths) > 0
    strength = np.zeros(both.shape, np.float32)
    if both.any():
        for rows, wide in _bands(one.window.rows):
            earlier, later = (_with_nothing(picture[wide], depth[wide]) for picture, depth in _parts(one))
            inner = slice(rows.start - wide.start, rows.stop - wide.start)
            strength[rows] = _beyond(earlier, later)[inner]
        strength[~both | (np.abs(strength) < _least(one, both))] = 0
    kept, areas = _areas(strength, one.window)
    return Compared(
        one.revision,
        one.frames,
        one.frames,
        window=one.window,
        strength=kept,
        unknown=is_seen & ~both,
        share=float(both.sum() / max(1, is_seen.sum())),
        unshown=one.unshown,
        areas=areas,
    )


def _parts(one: _Island) -> Iterator[tuple[AnyImage, AnyImage]]:
    return zip(one.pictures, one.depths, strict=True)


def _bands(rows: int) -> Iterator[tuple[slice, slice]]:
    """Slices of rows, and those with what lies around them."""
    for top in range(0, rows, BAND):
        bottom = min(top + BAND, rows)
        yield slice(top, bottom), slice(max(0, top - MISPLACED), min(rows, bottom + MISPLACED))


def _with_nothing(picture: AnyImage, depth: AnyImage) -> FloatImage:
    return np.asarray(np.where(depth > 0, picture.astype(np.float32), np.nan), np.float32)


def _beyond(earlier: FloatImage, later: FloatImage) -> FloatImage:
    """How far the later picture (h, w) lies beyond all that the earlier one shows within MISPLACED cells, or the earlier one
    beyond the later; signed as later less earlier."""
    added, gone = beyond(later, [earlier]), -beyond(earlier, [later])
    return np.where(np.abs(added) >= np.abs(gone), added, gone)


def _least(one: _Island, both: Mask) -> float:
    """From which contrast on two pictures differ by more than they usually do."""
    rows, columns = (where[::SAMPLE] for where in np.nonzero(both))
    apart = one.pictures[1][rows, columns].astype(np.float32) - one.pictures[0][rows, columns]
    return max(LEAST_CONTRAST, NOISES * usual_deviation(apart - np.median(apart)))


def _areas(strength: FloatImage, window: Grid) -> tuple[FloatImage, list[ChangedArea]]:
    """The strength without specks, and the areas that are left, the largest first."""
    count, labels, facts, middles = cv2.connectedComponentsWithStats((strength != 0).astype(np.uint8), connectivity=8)
    cells = facts[:, cv2.CC_STAT_AREA]
    is_large = cells >= LEAST_CELLS
    is_large[0] = False
    sums = np.bincount(labels.ravel(), weights=strength.ravel(), minlength=count)
    largest = [int(label) for label in np.argsort(-cells) if is_large[label]][:MOST_AREAS]
    areas = [
        ChangedArea(
            *window.place_of(*middles[label].tolist()),
            float(cells[label]) * window.cell**2,
            float(sums[label] / cells[label]),
        )
        for label in largest
    ]
    return np.where(is_large[labels], strength, np.float32(0)), areas


def _rows_columns(window: Grid, table: FrameTable, number: int) -> tuple[tuple[int, int], tuple[int, int]] | None:
    """Rows and columns of a window that a frame's box takes; None for none."""
    boxes = [table.boxes[index] for index, one in enumerate(table.frames) if one.number == number]
    if not boxes or not np.isfinite(boxes[0]).all():
        return None
    left, top, right, bottom = ((boxes[0] - [window.left, window.top] * 2) / window.cell).tolist()
    columns = max(0, int(left)), min(window.columns, int(right) + 1)
    rows = max(0, int(top)), min(window.rows, int(bottom) + 1)
    return (rows, columns) if rows[0] < rows[1] and columns[0] < columns[1] else None


def _corner(window: Grid, column: int, row: int) -> tuple[float, float]:
    return window.left + column * window.cell, window.top + row * window.cell


def _was_merged(root: Path) -> bool:
    """Whether the folder says so; what cannot be read is logged and says nothing."""
    try:
        with inside.reading(root / PROGRESS_NAME, root) as file:
            told = json.loads(file.read(MOST_BYTES))
    except FileNotFoundError:
        return False
    except (OSError, ValueError, RecursionError) as error:
        logger.warning("%s does not tell whether flights were merged: %s", PROGRESS_NAME, error)
        return False
    return isinstance(told, dict) and told.get("command") == "merge"
