"""Detection maps of a flight, for whoever asks: kept until there is something new and making them again costs little."""

from __future__ import annotations

import math
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Collection
from statistics import median

import numpy as np

from gcs_mosaic.detection.detection_map import DetectionMap, detection_map
from gcs_mosaic.detection.measured_frames import MeasuredFrames
from gcs_mosaic.detection.persons import Person
from gcs_mosaic.errors import UsageError
from gcs_mosaic.views.coverage import SeenIsland
from gcs_mosaic.views.flight_view import FlightView

KEPT_MAPS = 8  # islands, postures and clothes
MOST_MEASURED = 40_000  # frames of all sizes, 15 KB each
MOST_SIZES = 32  # empty ones cost next to nothing
ASKED_S = 20.0  # frames are measured, and kept whatever there is, for so long after somebody has asked
REST = 10.0  # a map is made again after so many times as much as it cost
LEAST_REST_S, MOST_REST_S = 1.0, 60.0
SIZE_STEPS = 50  # to a factor of e: sizes that differ by less share their measurements


class Detections:
    """Thread-safe. `coverage_of`: an island as it was seen."""

    def __init__(self, view: FlightView, coverage_of: Callable[[int], SeenIsland]) -> None:
        self._view, self._coverage_of = view, coverage_of
        self._lock = threading.Lock()
        self._sizes: OrderedDict[int, MeasuredFrames] = OrderedDict()  # the one that was asked for last is the last
        self._asked: dict[int, float] = {}
        self._maps: OrderedDict[tuple[int, Person, int], tuple[float, tuple[int, int], DetectionMap]] = OrderedDict()

    def of(self, island: int, person: Person, side_units: float) -> DetectionMap | None:
        """Of the frames measured so far; None of an island without a painted frame. `side_units`: of the person, canvas units."""
        size = _size_of(side_units)
        with self._lock:
            return self._map(island, person, size, self._measured(size, island))

    def step(self) -> bool:
        """Measure a frame for the size that was asked for last; False if there is none, or no room for it."""
        with self._lock:
            self._make_room()
            measured = next(reversed(self._sizes.values()), None)
            is_full = sum(one.count for one in self._sizes.values()) >= MOST_MEASURED
        return measured is not None and not is_full and measured.step()

    def whole(
        self, island: int, person: Person, side_units: float, told: Callable[[int, int], None] | None = None
    ) -> DetectionMap | None:
        """As `of`, once all frames are measured: it takes as long as that takes. `told`: of how many that are measured."""
        begun = self.of(island, person, side_units)
        frames, done = (0, 0) if begun is None else (begun.frames, begun.measured)
        while self.step():
            done += 1
            if told is not None:
                told(min(done, frames), frames)
        with self._lock:
            self._maps.clear()
        return self.of(island, person, side_units)

    def known(self, island: int, person: Person, side_units: float) -> DetectionMap | None:
        """As `of`, but nothing is measured for that. Raises UsageError, in a sentence, while frames are not measured."""
        size = _size_of(side_units)
        with self._lock:
            measured = self._sizes.get(size)
            found = None if measured is None else self._map(island, person, size, measured)
        frames = sum(one.island == island for one in self._view.table().frames) if found is None else found.frames
        done = 0 if found is None else found.measured
        if done < frames:
            told = f"{done} of {frames} frames are measured for this person so far"
            raise UsageError(f"{told}: show the layer under Probability until all are, then ask again.")
        return found

    def of_some(self, island: int, person: Person, side_units: float, numbers: Collection[int]) -> DetectionMap | None:
        """As `of`, as if there were only the frames of these numbers; it is not kept."""
        size = _size_of(side_units)
        with self._lock:
            measured = self._measured(size, island)
        seen = self._coverage_of(island)
        if seen.coverage is None:
            return None
        side = math.exp(size / SIZE_STEPS)
        return detection_map(self._view, island, seen.coverage, seen.gaps, measured, person, side, numbers)

    def forget_pictures(self) -> None:
        """Nobody is asking."""
        with self._lock:
            sizes = list(self._sizes.values())
        for one in sizes:
            one.forget_pictures()

    def _map(self, island: int, person: Person, size: int, measured: MeasuredFrames) -> DetectionMap | None:
        state = self._view.table().revision, measured.count
        known = self._maps.get((island, person, size))
        if known is not None and (known[1] == state or time.monotonic() < known[0]):
            self._maps.move_to_end((island, person, size))
            return known[2]
        seen, began = self._coverage_of(island), time.thread_time()
        if seen.coverage is None:
            return None
        side = math.exp(size / SIZE_STEPS)
        made = detection_map(self._view, island, seen.coverage, seen.gaps, measured, person, side)
        rest = min(max(LEAST_REST_S, REST * (time.thread_time() - began)), MOST_REST_S)
        self._maps[island, person, size] = time.monotonic() + rest, state, made
        self._maps.move_to_end((island, person, size))
        while len(self._maps) > KEPT_MAPS:
            self._maps.popitem(last=False)
        return made

    def _measured(self, size: int, island: int) -> MeasuredFrames:
        """The one for a size, which was asked for last from now on."""
        if size not in self._sizes:
            self._sizes[size] = MeasuredFrames(self._view, math.exp(size / SIZE_STEPS))
        self._sizes.move_to_end(size)
        self._sizes[size].want(island)
        self._asked[size] = time.monotonic()
        self._make_room()
        return self._sizes[size]

    def _make_room(self) -> None:
        """Forget the sizes that were not asked for the longest, but none that somebody looks at."""
        for size in list(self._sizes)[:-1]:
            if sum(one.count for one in self._sizes.values()) < MOST_MEASURED and len(self._sizes) <= MOST_SIZES:
                return
            if time.monotonic() - self._asked[size] >= ASKED_S:
                del self._sizes[size], self._asked[size]


def _size_of(side_units: float) -> int:
    return round(math.log(side_units) * SIZE_STEPS)


def units_of_pixel(view: FlightView, island: int) -> float | None:
    """Canvas units of a pixel of an island's usual original; None of an island without a frame."""
    found = [float(np.exp(one.pose.log_gsd)) for one in view.table().frames if one.island == island]
    return median(found) if found else None
