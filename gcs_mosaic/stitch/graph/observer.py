"""Observers of the placing of frames: for debug pictures and logs. Nothing is computed without one."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from gcs_mosaic.stitch.arrays import Points32Nx2, PointsNx2
from gcs_mosaic.stitch.camera.geometry import canvas_from_pixels
from gcs_mosaic.stitch.camera.relief import on_plane
from gcs_mosaic.stitch.graph.placement import Placement
from gcs_mosaic.stitch.graph.view_graph import ViewGraph
from gcs_mosaic.stitch.registration.outcome import NotRegistered, Registration

logger = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Residuals:
    """Match residuals of a frame: its matches on the canvas (m, 2), and the offsets from there to the linked frames' (m, 2)."""

    name: str
    places: PointsNx2
    misses: PointsNx2


class Observer(Protocol):
    """Is notified of everything that decides where frames lie, in order."""

    def registered(self, a: str, b: str, found: Registration | NotRegistered) -> None:
        """Frame a was compared with frame b; pixels in `found` are full-resolution ones."""

    def disbelieved(self, name: str, beside: str, reason: str) -> None:
        """A frame was registered with a placed one, but its pose there was rejected."""

    def placed(self, placement: Placement) -> None:
        """A frame was placed for the first time, or again after it was taken back."""

    def adjusted(self, island: int, residuals: Callable[[], Sequence[Residuals]]) -> None:
        """A whole island was adjusted; `residuals()` returns the residuals by frame, if called at once."""


class Observers:
    """Forwards to several observers. One that raises is dropped: observing must not change the result."""

    def __init__(self, *observers: Observer | None) -> None:
        self._observers = [observer for observer in observers if observer is not None]

    def registered(self, a: str, b: str, found: Registration | NotRegistered) -> None:
        self._tell(lambda observer: observer.registered(a, b, found))

    def disbelieved(self, name: str, beside: str, reason: str) -> None:
        self._tell(lambda observer: observer.disbelieved(name, beside, reason))

    def placed(self, placement: Placement) -> None:
        self._tell(lambda observer: observer.placed(placement))

    def adjusted(self, island: int, residuals: Callable[[], Sequence[Residuals]]) -> None:
        self._tell(lambda observer: observer.adjusted(island, residuals))

    def _tell(self, what: Callable[[Observer], None]) -> None:
        for observer in list(self._observers):
            try:
                what(observer)
            except Exception:
                logger.exception("%s has failed, and looks on no more", type(observer).__name__)
                self._observers.remove(observer)


def island_residuals(graph: ViewGraph, island: int) -> list[Residuals]:
    """Residuals of the matches of an island's frames at their present poses, lens and relief applied; NaN above the horizon."""
    of_frame: dict[int, list[tuple[PointsNx2, PointsNx2]]] = {frame: [] for frame in graph.members(island).tolist()}
    for (a, b), link in graph.links.items():
        if a in of_frame and b in of_frame:
            place_a, place_b = _places(graph, a, link.pixels_a), _places(graph, b, link.pixels_b)
            of_frame[a].append((place_a, place_b - place_a))
            of_frame[b].append((place_b, place_a - place_b))
    return [
        Residuals(graph.frames[frame].name, *(np.concatenate([part[k] for part in parts]) for k in (0, 1)))
        for frame, parts in of_frame.items()
        if parts
    ]


def _places(graph: ViewGraph, frame: int, pixels: PointsNx2 | Points32Nx2) -> PointsNx2:
    camera = graph.camera_of(frame)
    level_ground = on_plane(graph.frames[frame].relief, camera, pixels.astype(np.float64))
    return canvas_from_pixels(graph.pose_of(frame), camera, level_ground)
