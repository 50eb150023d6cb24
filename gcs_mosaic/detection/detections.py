"""Detection maps of a flight, for whoever asks: kept until there is something new and making them again costs little."""

from __future__ import annotations

import math
import threading
import time
from collections import OrderedDict
from collections.abc import Callable
from statistics import median

import numpy as np

from gcs_mosaic.detection.detection_map import DetectionMap, detection_map
from gcs_mosaic.detection.measured_frames import MeasuredFrames
from gcs_mosaic.detection.persons import Person
from gcs_mosaic.errors import UsageError
from gcs_mosaic.views.coverage import SeenIsland
from gcs_mosaic.views.flight_view import FlightView

KEPT_SIZES, KEPT_MAPS = 2, 8  # postures; islands, postures and clothes
REST = 10.0  # a map is made again after so many times as much as it cost
LEAST_REST_S = 1.0
SIZE_STEPS = 50  # to a factor of e: sizes that differ by less share their measurements


class Detections:
    """Thread-safe. `coverage_of`: an island as it was seen."""

    def __init__(self, view: FlightView, coverage_of: Callable[[int], SeenIsland]) -> None:
        self._view, self._coverage_of = view, coverage_of
        self._lock = threading.Lock()
        self._sizes: OrderedDict[int, MeasuredFrames] = OrderedDict()
        self._maps: OrderedDict[tuple[int, Person, int], tuple[float, tuple[int, int], DetectionMap]] = OrderedDict()

    def of(self, island: int, person: Person, side_units: float) -> DetectionMap | None:
        """Of the frames measured so far; None of an island without a painted frame. `side_units`: of the person, canvas units."""
        size = round(math.log(side_units) * SIZE_STEPS)
        with self._lock:
            measured = self._measured(size)
            state = self._view.table().revision, measured.count
            known = self._maps.get((island, person, size))
            if known is not None and (known[1] == state or time.monotonic() < known[0]):
                return known[2]
            seen, began = self._coverage_of(island), time.thread_time()
            if seen.coverage is None:
                return None
            side = math.exp(size / SIZE_STEPS)
            made = detection_map(self._view, island, seen.coverage, seen.gaps, measured, person, side)
            rest = max(LEAST_REST_S, REST * (time.thread_time() - began))
            self._maps[island, person, size] = time.monotonic() + rest, state, made
            while len(self._maps) > KEPT_MAPS:
                self._maps.popitem(last=False)
            return made

    def step(self) -> bool:
        """Measure a frame for the size that was asked for last; False if there is none."""
        with self._lock:
            measured = next(reversed(self._sizes.values()), None)
        return measured is not None and measured.step()

    def whole(self, island: int, person: Person, side_units: float) -> DetectionMap | None:
        """As `of`, once all frames are measured: it takes as long as that takes."""
        self.of(island, person, side_units)
        while self.step():
            pass
        with self._lock:
            self._maps.clear()
        return self.of(island, person, side_units)

    def known(self, island: int, person: Person, side_units: float) -> DetectionMap | None:
        """As `of`. Raises UsageError, in a sentence, while frames are not measured."""
        found = self.of(island, person, side_units)
        if found is not None and found.measured < found.frames:
            told = f"{found.measured} of {found.frames} frames are measured for this person so far"
            raise UsageError(f"{told}: show the layer under Probability until all are, then ask again.")
        return found

    def _measured(self, size: int) -> MeasuredFrames:
        if size not in self._sizes:
            self._sizes[size] = MeasuredFrames(self._view, math.exp(size / SIZE_STEPS))
        self._sizes.move_to_end(size)
        while len(self._sizes) > KEPT_SIZES:
            self._sizes.popitem(last=False)
        return self._sizes[size]


def units_of_pixel(view: FlightView, island: int) -> float | None:
    """Canvas units of a pixel of an island's usual original; None of an island without a frame."""
    found = [float(np.exp(one.pose.log_gsd)) for one in view.table().frames if one.island == island]
    return median(found) if found else None
