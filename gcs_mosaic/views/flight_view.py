"""A flight's painted frames as they lie now, for whoever asks about places; shared by all questions."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gcs_mosaic.errors import UsageError
from gcs_mosaic.render.display import Display
from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.render.tile_grid import Box
from gcs_mosaic.stitch.arrays import Array, PointsNx2
from gcs_mosaic.stitch.camera.geometry import canvas_from_pixels, footprint, pixels_from_canvas
from gcs_mosaic.stitch.camera.relief import as_seen, on_plane
from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.revision import last_revision
from gcs_mosaic.views.sharpness import relative_sharpness
from gcs_mosaic.views.taken import CaptureTime, TakenTimes

if TYPE_CHECKING:
    import sqlite3

    from gcs_mosaic.store.ledger import Ledger
    from gcs_mosaic.store.records import (
        CoveredRecord,
        EventRecord,
        FlightRecord,
        FrameRecord,
        PositionRecord,
        ReportedPosition,
    )

logger = logging.getLogger(__name__)

OUTLINE_PER_SIDE = 4  # points; between them a lens bends the border by less than a pixel in a thousand
# The table is read again after so many times as much as reading it cost of a core: 5 % of it. By what it cost, not by how long
# it took: on a busy machine that is mostly waiting, and would make answers old when they are needed.
REST = 20.0
LEAST_REST_S = 0.25
MOST_REST_S = 0.5  # whatever it cost: answers are not to be older, and only what has changed is read anew
KEPT_FRAMES = 256  # with their relief: 4 KB each


@dataclass(frozen=True, slots=True)
class FrameTable:
    """All painted frames at one revision. `frames` and the arrays have the same order, that of arrival."""

    revision: int
    frames: Sequence[PositionRecord]
    islands: Array  # (n,) int
    outlines: Array  # (n, 16, 2) canvas, clockwise from the top left of the frame; NaN above the horizon
    boxes: Array  # (n, 4) canvas: left, top, right, bottom; NaN where nothing is seen
    sharpness: Array  # (n,) beside the frames around, see `relative_sharpness`
    since: Array  # (n,) when each was first known to lie on its island, monotonic seconds; -inf: in the first table that was read

    def near(self, island: int, box: Box) -> list[int]:
        """Indices of an island's frames whose bounding boxes touch a canvas box, in order of arrival."""
        left, top, right, bottom = box
        apart = (self.boxes[:, 0] > right) | (self.boxes[:, 2] < left) | (self.boxes[:, 1] > bottom)
        apart |= (self.boxes[:, 3] < top) | np.isnan(self.boxes[:, 0]) | (self.islands != island)
        return [int(index) for index in np.flatnonzero(~apart)]


class FlightView:
    """A flight's folder, read beside the program that may be writing it. Thread-safe.

    A table is kept until the revision has changed, and for `MOST_REST_S` at most after it was read; it tells its revision.
    """

    def __init__(self, root: Path) -> None:
        self.root = root
        self._lock = threading.Lock()
        self._table = table_of(0, [])
        self._due = 0.0  # monotonic seconds
        self._known = _KnownPositions()
        self.times = TakenTimes(root)
        self._taken: tuple[FrameTable | None, Array] = None, np.empty(0)
        self._painted = lru_cache(KEPT_FRAMES)(self._read_painted)

    def table(self, at_least: int = 0) -> FrameTable:
        """The painted frames, as of a revision or later if the folder is there already; none where there is no ledger yet."""
        with self._lock:
            if time.monotonic() >= self._due or self._table.revision < at_least:
                self._read_again()
            return self._table

    def taken(self, table: FrameTable) -> Array:
        """When a table's frames were taken (n,), seconds by one clock: to compare them by; NaN where nothing is known."""
        known, times = self._taken
        if known is table:
            return times
        try:
            with self.ledger() as ledger:
                told = ledger.message_times()
        except UsageError:
            logger.info("no ledger can be read", exc_info=True)
            return np.full(len(table.frames), np.nan)
        times = self.times.by_one_clock(table.frames, told)
        self._taken = table, times
        return times

    def capture_times(self, table: FrameTable) -> dict[int, CaptureTime]:
        """When each of a table's frames was taken, as far as that is known, by its number. Raises UsageError."""
        with self.ledger() as ledger:
            told = ledger.message_times()
        found = {one.number: self.times.of(one, told.get(one.number)) for one in table.frames}
        return {number: taken for number, taken in found.items() if taken is not None}

    def capture_time(self, number: int) -> CaptureTime | None:
        """The same of one frame, on the map or not. Raises UsageError."""
        with self.ledger() as ledger:
            frame = ledger.frame(number)
            return None if frame is None else self.times.of(frame, ledger.message_time(number))

    def painted(self, number: int) -> RenderItem | None:
        """How a frame is painted, with relief; None if it is not."""
        return self._painted(number, self.table().revision)

    def display(self, number: int) -> Display | None:
        """How a painted frame's bands are displayed; a covered one's as its keyframe's. None if neither is painted."""
        painted = self.painted(number)
        if painted is None:
            with self.ledger() as ledger:
                keyframe = ledger.keyframe_of(number)
            painted = None if keyframe is None else self.painted(keyframe)
        return None if painted is None else painted.display

    def flight(self) -> FlightRecord | None:
        """What the ledger says of the flight. Raises UsageError."""
        with self.ledger() as ledger:
            return ledger.flight()

    def frame(self, number: int) -> FrameRecord | None:
        """What the ledger says of a frame."""
        with self.ledger() as ledger:
            return ledger.frame(number)

    def frames(self) -> list[FrameRecord]:
        """All frames in the order in which they came. Raises UsageError."""
        with self.ledger() as ledger:
            return ledger.frames()

    def events(self) -> list[EventRecord]:
        """All events in the order in which they came. Raises UsageError."""
        with self.ledger() as ledger:
            return ledger.events()

    def shots_of_other_cameras(self) -> frozenset[int]:
        """Ids of events whose files are of a camera that is not mapped. Raises UsageError."""
        with self.ledger() as ledger:
            return ledger.shots_of_other_cameras()

    def reported_positions(self) -> list[ReportedPosition]:
        """What messages said of where frames were taken. Raises UsageError."""
        with self.ledger() as ledger:
            return ledger.reported_positions()

    def corner_deviations(self) -> list[tuple[int, float]]:
        """Island and how uncertain a frame lies, one standard deviation in canvas units. Raises UsageError."""
        with self.ledger() as ledger:
            return ledger.corner_deviations()

    def covered(self) -> list[CoveredRecord]:
        """All frames that painted ones cover. Raises UsageError."""
        with self.ledger() as ledger:
            return ledger.covered()

    def _read_again(self) -> None:
        revision, cost = last_revision(self.root), 0.0
        if revision != self._table.revision:
            try:
                with self.ledger() as ledger:
                    begun = time.thread_time()
                    self._table = table_of(revision, self._known.read(ledger), self._table)
                    cost = time.thread_time() - begun
            except UsageError:
                logger.info("no ledger can be read", exc_info=True)
        self._due = time.monotonic() + min(max(LEAST_REST_S, REST * cost), MOST_REST_S)

    def _read_painted(self, number: int, _revision: int) -> RenderItem | None:
        with self.ledger() as ledger:
            return ledger.painted_frame(number)

    def ledger(self) -> Ledger:
        """Opened for each reading, by the thread that reads: the file may be written anew at any time. Raises UsageError."""
        from gcs_mosaic.store.ledger import Ledger  # it loads what paints, which a page that nobody asks does without

        return Ledger(self.root / LEDGER_NAME, read_only=True)


def pixels_of(painted: RenderItem, places: PointsNx2) -> PointsNx2:
    """Pixels (n, 2) of a painted frame, inside it or not, where canvas places (n, 2) are seen: lens and relief included. NaN
    where the lens cannot see them."""
    flat = pixels_from_canvas(painted.pose, painted.camera, places)
    return as_seen(painted.relief, painted.camera, flat)


def places_of(painted: RenderItem, pixels: PointsNx2) -> PointsNx2:
    """Canvas places (n, 2) of a painted frame's pixels (n, 2); NaN above the horizon. Inverse of `pixels_of`."""
    return canvas_from_pixels(painted.pose, painted.camera, on_plane(painted.relief, painted.camera, pixels))


class _KnownPositions:
    """Records by number, with the rows that they were made of: only what has changed since is made anew."""

    def __init__(self) -> None:
        self._known: dict[int, tuple[sqlite3.Row, PositionRecord]] = {}

    def read(self, ledger: Ledger) -> list[PositionRecord]:
        """All painted frames; the same object for what lies as before."""
        from gcs_mosaic.store.rows import position_record_of  # as in `FlightView.ledger`

        now: dict[int, tuple[sqlite3.Row, PositionRecord]] = {}

        def record(row: sqlite3.Row) -> PositionRecord:
            before = self._known.get(row["frame"])
            now[row["frame"]] = before if before is not None and before[0] == row else (row, position_record_of(row))
            return now[row["frame"]][1]

        records = ledger.positions(record)
        self._known = now
        return records


def table_of(revision: int, frames: Sequence[PositionRecord], before: FrameTable | None = None) -> FrameTable:
    """The table of some frames; the outlines of those that are in a table `before` are taken from there."""
    known = {} if before is None else {id(one): index for index, one in enumerate(before.frames)}
    outlines = np.full((len(frames), 4 * OUTLINE_PER_SIDE, 2), np.nan)
    for index, one in enumerate(frames):
        if before is None or (at := known.get(id(one))) is None:
            outlines[index] = footprint(one.pose, one.camera, OUTLINE_PER_SIDE)
        else:
            outlines[index] = before.outlines[at]
    seen = ~np.isnan(outlines)
    low, high = np.where(seen, outlines, np.inf).min(axis=1), np.where(seen, outlines, -np.inf).max(axis=1)
    boxes = np.hstack([low, high])
    boxes[~np.isfinite(boxes).all(axis=1)] = np.nan
    islands = np.array([one.island for one in frames], dtype=int)
    sharpness = relative_sharpness(islands, boxes, [one.sharpness for one in frames])
    return FrameTable(revision, frames, islands, outlines, boxes, sharpness, _since(frames, before))


def _since(frames: Sequence[PositionRecord], before: FrameTable | None) -> Array:
    if before is None or not before.frames:
        return np.full(len(frames), -np.inf)
    known = {(one.number, one.island): since for one, since in zip(before.frames, before.since, strict=True)}
    now = time.monotonic()
    return np.array([known.get((one.number, one.island), now) for one in frames], dtype=float)
