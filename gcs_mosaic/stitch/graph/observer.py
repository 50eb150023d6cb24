"""Who may look on while frames are placed: for debug pictures and protocols. Nothing is worked out where nobody looks."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.stitch.camera.geometry import canvas_from_pixels
from gcs_mosaic.stitch.camera.relief import on_plane
from gcs_mosaic.stitch.graph.placement import Placement
from gcs_mosaic.stitch.graph.view_graph import ViewGraph
from gcs_mosaic.stitch.registration.registration import NotRegistered, Registration

logger = logging.getLogger(__name__)

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Residuals:
    """Where the matches of a frame miss: its places for them (m, 2), and from there to the linked frames' (m, 2), canvas."""

    name: str
    places: Array
    misses: Array


class Observer(Protocol):
    """Is told of everything that decides where frames lie, in the order in which it happens."""

    def registered(self, a: str, b: str, found: Registration | NotRegistered) -> None:
        """Frame a was compared with frame b; pixels of a and b in `found` are full-resolution ones."""

    def disbelieved(self, name: str, beside: str, reason: str) -> None:
        """A frame was registered with a placed one, but its pose there is not to be believed."""

    def placed(self, placement: Placement) -> None:
        """A frame lies on the map for the first time, or again after it was taken back."""

    def adjusted(self, island: int, residuals: Callable[[], Sequence[Residuals]]) -> None:
        """A whole island was adjusted, and `residuals()` tells what is left over, frame by frame, if asked at once."""


class Observers:
    """Passes everything on to several. One that raises is told no more: whoever looks on must not change what happens."""

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
    """What the matches of an island's frames miss by as they lie now, lens and relief applied; NaN above the horizon."""
    of_frame: dict[int, list[tuple[Array, Array]]] = {frame: [] for frame in graph.members(island).tolist()}
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


def _places(graph: ViewGraph, frame: int, pixels: Array) -> Array:
    camera = graph.camera_of(frame)
    level_ground = on_plane(graph.frames[frame].relief, camera, pixels)
    return canvas_from_pixels(graph.pose_of(frame), camera, level_ground)
