"""Ground that people have pointed at, which stays where it is when the map moves.

A place on the canvas means nothing for long: an adjustment moves frames, and islands that join get one canvas. What was pointed
at is a thing in a picture, so it is bound to a pixel of a frame, and lies wherever that pixel is painted now, with lens and
relief. Set in an original it is bound to that; set on the map, to the frame that shows the place best at that moment. Where
islands join, their frames move, and what is bound to them goes along. Pixels are those of the original, also
where it is stitched at a half or a quarter of its size.

If that frame is no longer painted the place is told as it was set, and that it does not follow.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from gcs_mosaic.stitch.camera.geometry import pixels_from_canvas
from gcs_mosaic.views.flight_view import FlightView, FrameTable, pixels_of, places_of

if TYPE_CHECKING:
    from gcs_mosaic.store.records import PositionRecord

MOST_CANDIDATES = 200  # frames at a place that are compared; of those that lie about it the nearest
KEPT_PLACES = 8192


@dataclass(frozen=True, slots=True, kw_only=True)
class Binding:
    """Where something was set on the canvas of an island; the frame (by name) and pixel of its original it is bound to."""

    island: int
    x: float
    y: float
    frame: str | None = None
    pixel: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class GroundPlace:
    """Where something lies now; `number`: of the frame that it follows, None if that is not painted."""

    island: int
    x: float
    y: float
    number: int | None


class GroundFollower:
    """Binds places to frames, and tells where they lie. Thread-safe."""

    def __init__(self, view: FlightView) -> None:
        self._view = view
        self._lock = threading.Lock()
        self._named: tuple[FrameTable | None, dict[str, PositionRecord]] = (None, {})
        self._width = lru_cache(KEPT_PLACES)(self._original_width)
        self._place = lru_cache(KEPT_PLACES)(self._painted_place)

    def bound(self, island: int, x: float, y: float) -> Binding:
        """A place on an island's canvas, bound to the frame that shows it best: finely, and near its middle."""
        best = self._best(island, x, y)
        painted = None if best is None else self._view.painted(best.number)
        if best is None or painted is None:
            return Binding(island=island, x=x, y=y)
        pixel = pixels_of(painted, np.array([[x, y]]))[0]
        if not np.isfinite(pixel).all():
            return Binding(island=island, x=x, y=y)
        factor = self._factor(best)
        in_original = ((float(pixel[0]) + 0.5) * factor - 0.5, (float(pixel[1]) + 0.5) * factor - 0.5)
        return Binding(island=island, x=x, y=y, frame=best.name, pixel=in_original)

    def bound_to_pixel(self, number: int, x: float, y: float, *, beside: bool = False) -> Binding | None:
        """A pixel of a frame's original (by number); None if that is not painted, or the pixel above the horizon or outside
        (`beside`: by more than the frame is large)."""
        one = next((found for found in self._view.table().frames if found.number == number), None)
        if one is None:
            return None
        width, height = (self._factor(one) * side for side in (one.camera.width, one.camera.height))
        if not (-beside * width <= x <= (1 + beside) * width and -beside * height <= y <= (1 + beside) * height):
            return None
        place = self._place(one, x, y)
        return place and Binding(island=one.island, x=place[0], y=place[1], frame=one.name, pixel=(x, y))

    def place(self, binding: Binding) -> GroundPlace:
        """Where it lies now."""
        one = None if binding.frame is None else self._by_name().get(binding.frame)
        place = None if one is None or binding.pixel is None else self._place(one, *binding.pixel)
        if one is None or place is None:
            return GroundPlace(island=binding.island, x=binding.x, y=binding.y, number=None)
        return GroundPlace(island=one.island, x=place[0], y=place[1], number=one.number)

    def factor_of(self, number: int) -> float:
        """Pixels of a painted frame's original for one of the frame as it is painted."""
        return next((self._factor(one) for one in self._view.table().frames if one.number == number), 1.0)

    def _best(self, island: int, x: float, y: float) -> PositionRecord | None:
        table = self._view.table()
        near = table.near(island, (x, y, x, y))
        if len(near) > MOST_CANDIDATES:
            middles = (table.boxes[near, :2] + table.boxes[near, 2:]) / 2 - (x, y)
            near = [near[at] for at in np.argsort(np.linalg.norm(middles, axis=1))[:MOST_CANDIDATES]]
        costs = {index: _cost(table.frames[index], x, y) for index in near}
        best = min(costs, key=costs.__getitem__, default=None)
        return None if best is None or not np.isfinite(costs[best]) else table.frames[best]

    def _factor(self, one: PositionRecord) -> float:
        """Pixels of the original for one of the frame as it is painted: 1, 2 or 4."""
        width = self._width(one.number)
        return 1.0 if width is None else float(round(width / one.camera.width)) or 1.0

    def _by_name(self) -> dict[str, PositionRecord]:
        table = self._view.table()
        with self._lock:
            if self._named[0] is not table:
                self._named = table, {one.name: one for one in table.frames}
            return self._named[1]

    def _original_width(self, number: int) -> int | None:
        frame = self._view.frame(number)
        return None if frame is None else frame.width

    def _painted_place(self, one: PositionRecord, x: float, y: float) -> tuple[float, float] | None:
        """`one` is all that tells one painting of a frame from another."""
        painted = self._view.painted(one.number)
        if painted is None:
            return None
        factor = self._factor(one)
        place = places_of(painted, (np.array([[x, y]]) + 0.5) / factor - 0.5)[0]
        return (float(place[0]), float(place[1])) if np.isfinite(place).all() else None


def _cost(one: PositionRecord, x: float, y: float) -> float:
    """Canvas units per pixel, dearer towards the frame's border; infinite outside."""
    pixel = pixels_from_canvas(one.pose, one.camera, np.array([[x, y]]))[0]
    size = np.array([one.camera.width, one.camera.height])
    from_middle = np.abs(2 * pixel / size - 1).max()
    return float(np.exp(one.pose.log_gsd) * (1 + from_middle)) if from_middle <= 1 else float("inf")
