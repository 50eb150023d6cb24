"""Who moves: tracks of things that change place between consecutive looks of a flight. Hints, and never a filter.

Sought while somebody asks, a piece of work with each question, so that it costs nothing when nobody looks.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gcs_mosaic.errors import UsageError
from gcs_mosaic.hints.moved_blobs import AROUND, moved_in
from gcs_mosaic.hints.mover_tracks import SeenBlob, tracks_of
from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.stitch.arrays import Array, FloatImage, PointsNx2
from gcs_mosaic.views.coverage import Grid
from gcs_mosaic.views.flight_view import FlightView, FrameTable, pixels_of, places_of
from gcs_mosaic.views.ground_window import OnGround, flat_picture, laid
from gcs_mosaic.views.pictures import NoPicture

logger = logging.getLogger(__name__)

BESIDE = (
    3  # looks before and after one that it is compared with: with four fifths of overlap they see most of its ground
)
LONGER_SIDE = 1000  # cells of a frame's window at most
FINEST = 2.0  # pixels of the frame that a cell is wide at least: what is compared lies apart by a pixel or two
KEPT_PICTURES = 2 * BESIDE + 2  # of half a megapixel each, float32
WORK_S = 1.0  # for each question; a frame that was begun is finished
REST = 20.0  # tracks are linked again after so many times as much as linking them cost of a core: 5 % of it
RETRY_S = (
    10.0  # until a frame is tried again that a passing trouble kept from being searched; longer if trying takes long
)
KEPT_ISLANDS = 4  # whose tracks are remembered


Picture = tuple[int, str | None]  # a frame's number, and what tells its content from another's


@dataclass(frozen=True, slots=True)
class Movers:
    """Tracks, each in order of time, as of a revision of the map; how many of an island's frames were searched, of how many."""

    revision: int
    tracks: Sequence[Sequence[SeenBlob]]
    searched: int
    frames: int


@dataclass(frozen=True, slots=True)
class _Told:
    """An answer. `made`: of which revision, and after how many searched frames; `due`: monotonic seconds."""

    made: tuple[int, int]
    due: float
    movers: Movers


@dataclass(frozen=True, slots=True)
class _Found:
    """What one frame alone shows: pixels (n, 2) of it as it is painted, sizes in such pixels, contrasts.

    `beside`: whom it was compared with.
    """

    beside: tuple[Picture, ...]
    pixels: PointsNx2
    per_pixel: float  # pixels of the original for each of these
    sizes: Array
    contrasts: Array


class MoverSearch:
    """Of one flight. Thread-safe; several who ask share the work."""

    def __init__(self, view: FlightView) -> None:
        self._view = view
        self._lock = threading.Lock()
        self._found: dict[Picture, _Found] = {}
        self._searched = 0  # frames, some of them again
        self._again: dict[Picture, float] = {}  # when to try them again, in monotonic seconds
        self._flat: OrderedDict[Picture, FloatImage] = OrderedDict()
        self._telling = threading.Lock()
        self._answers: OrderedDict[int, _Told] = OrderedDict()  # by island

    def ask(self, island: int, work_s: float = WORK_S) -> Movers:
        """What is known of an island, after so many seconds of further work; at once while another's question is worked on. The
        answer may be one of a moment ago: it tells of how many frames it is made."""
        table = self._view.table()
        series = _series(table, island)
        if self._lock.acquire(blocking=False):
            try:
                self._work(table, series, time.monotonic() + work_s)
            finally:
                self._lock.release()
        with self._telling:
            return self._answer(island, table, series)

    def _answer(self, island: int, table: FrameTable, series: Sequence[list[int]]) -> Movers:
        made, known = (table.revision, self._searched), self._answers.get(island)
        if known is None or (known.made != made and time.monotonic() >= known.due):
            begun = time.thread_time()
            movers = self._told(table, series)
            cost = time.thread_time() - begun
            known = _Told(made, time.monotonic() + REST * cost, movers)
            self._answers[island] = known
        self._answers.move_to_end(island)
        while len(self._answers) > KEPT_ISLANDS:
            self._answers.popitem(last=False)
        return known.movers

    def _work(self, table: FrameTable, series: Sequence[list[int]], end: float) -> None:
        if len(self._found) > len(table.frames):
            there = {_picture_of(table, index) for index in range(len(table.frames))}
            self._found = {picture: found for picture, found in self._found.items() if picture in there}
        for indices in series:
            for at, index in enumerate(indices):
                picture = _picture_of(table, index)
                near = [other for other in indices[max(0, at - BESIDE) : at + BESIDE + 1] if other != index]
                beside = tuple(_picture_of(table, other) for other in near)
                known = self._found.get(picture)
                if known is not None and known.beside == beside:
                    continue
                begun = time.monotonic()
                if begun >= end:
                    return
                if begun >= self._again.get(picture, begun):
                    self._try(table, index, beside)

    def _try(self, table: FrameTable, index: int, beside: tuple[Picture, ...]) -> None:
        """Search a frame; one that cannot be for now, or not beside those, counts as not searched until it was."""
        picture, begun = _picture_of(table, index), time.monotonic()
        try:
            self._found[picture] = self._searched_or_nothing(table, index, beside)
        except NoPicture as reason:
            logger.info("frame %d is searched later for what moves: %s", picture[0], reason)
            now = time.monotonic()
            self._again[picture] = now + max(RETRY_S, REST * (now - begun))
        else:
            self._again.pop(picture, None)
            self._searched += 1

    def _searched_or_nothing(self, table: FrameTable, index: int, beside: tuple[Picture, ...]) -> _Found:
        """A frame that cannot be searched is not tried with each question, and does not keep the others from being searched.
        Raises UsageError while the flight's ledger cannot be read, which is no fault of the frame, and NoPicture for what
        passes."""
        try:
            return self._search(table, index, beside)
        except (UsageError, NoPicture):
            raise
        except Exception:
            logger.exception("frame %s cannot be searched for what moves", table.frames[index].number)
            return _nothing(beside)

    def _search(self, table: FrameTable, index: int, beside: tuple[Picture, ...]) -> _Found:
        own_picture = _picture_of(table, index)
        number = own_picture[0]
        lies = self._lying(number)
        window = _window_of(table, index)
        own = None if lies is None or window is None else self._look(own_picture, lies, window)
        if lies is None or window is None or own is None:
            return _nothing(beside)
        others = [
            look
            for other in beside
            if (lying := self._lying(other[0])) is not None and (look := self._look(other, lying, window)) is not None
        ]
        blobs = moved_in(own, others)
        places = np.array([window.place_of(one.column, one.row) for one in blobs]).reshape(-1, 2)
        return _Found(
            beside,
            pixels_of(lies.painted, places),
            (record.width / lies.painted.camera.width)
            if (record := self._view.frame(number)) and record.width
            else 1.0,
            np.array([one.size * window.cell for one in blobs]) / _nominal_gsd(lies.painted),
            np.array([one.contrast for one in blobs]),
        )

    def _lying(self, number: int) -> OnGround | None:
        painted = self._view.painted(number)
        return None if painted is None else OnGround(painted)

    def _look(self, of: Picture, lies: OnGround, window: Grid) -> FloatImage | None:
        flat = self._picture(of, lies, window)
        if flat is None:
            return None
        shown, seen = laid(lies, flat[..., None], window)
        return np.where(seen, shown[..., 0], np.float32(np.nan)) if seen.any() else None

    def _picture(self, of: Picture, lies: OnGround, window: Grid) -> FloatImage | None:
        """A frame `flattened`, about as fine as the window's cells; None if its original cannot be shown."""
        if of in self._flat:
            self._flat.move_to_end(of)
            return self._flat[of]
        flat = flat_picture(self._view, of[0], lies, window, AROUND)
        if flat is None:
            return None
        self._flat[of] = flat
        while len(self._flat) > KEPT_PICTURES:
            self._flat.popitem(last=False)
        return self._flat[of]

    def _told(self, table: FrameTable, series: Sequence[list[int]]) -> Movers:
        taken, tracks, searched = self._view.taken(table), list[list[SeenBlob]](), 0
        for indices in series:
            times = taken[indices]
            is_even = len(times) > 1 and bool(np.isfinite(times).all()) and bool((np.diff(times) > 0).all())
            seen = list[SeenBlob]()
            for turn, index in enumerate(indices):
                found = self._found.get(_picture_of(table, index))
                searched += found is not None
                if found is not None:
                    seen += self._seen(table.frames[index].number, found, turn, times[turn] if is_even else turn)
            tracks += tracks_of(seen)
        return Movers(table.revision, tracks, searched, sum(map(len, series)))

    def _seen(self, number: int, found: _Found, turn: int, at: float) -> list[SeenBlob]:
        """Where the things of a frame lie now."""
        painted = self._view.painted(number)
        if painted is None or not len(found.pixels):
            return []
        places = places_of(painted, found.pixels)
        originals = (found.pixels + 0.5) * found.per_pixel - 0.5
        sizes = found.sizes * _nominal_gsd(painted)
        every = zip(places.tolist(), originals.tolist(), sizes.tolist(), found.contrasts.tolist(), strict=True)
        return [
            SeenBlob(turn, float(at), x, y, size, contrast, number, (px, py))
            for (x, y), (px, py), size, contrast in every
            if np.isfinite(x)
        ]


def _picture_of(table: FrameTable, index: int) -> Picture:
    return table.frames[index].number, table.frames[index].content_hash


def _nominal_gsd(painted: RenderItem) -> float:
    """Canvas units per pixel below the camera, which an island that joins another changes."""
    return float(np.exp(painted.pose.log_gsd))


def _nothing(beside: tuple[Picture, ...]) -> _Found:
    return _Found(beside, np.empty((0, 2)), 1.0, np.empty(0), np.empty(0))


def _series(table: FrameTable, island: int) -> list[list[int]]:
    """Indices of an island's frames in order of capture, those of each aircraft for themselves."""
    ours = [index for index, one in enumerate(table.frames) if one.island == island]
    aircraft = sorted({table.frames[index].vehicle for index in ours}, key=lambda one: (one is not None, one))
    return [
        sorted((index for index in ours if table.frames[index].vehicle == one), key=lambda k: table.frames[k].order)
        for one in aircraft
    ]


def _window_of(table: FrameTable, index: int) -> Grid | None:
    left, top, right, bottom = table.boxes[index].tolist()
    one, longer = table.frames[index], max(right - left, bottom - top)
    if not np.isfinite(longer) or longer <= 0:
        return None
    cell = max(FINEST * float(np.exp(one.pose.log_gsd)), longer / LONGER_SIDE)
    return Grid(left, top, cell, max(1, int((right - left) / cell)), max(1, int((bottom - top) / cell)))
