"""Where hints lie on the map as it is now."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from gcs_mosaic.hints.hint_file import KnownHint
from gcs_mosaic.stitch.camera.geometry import ground_sampling_distance
from gcs_mosaic.views.flight_view import FlightView, places_of


@dataclass(frozen=True, slots=True)
class HintPlace:
    """Middle and larger side, canvas units of an island."""

    island: int
    x: float
    y: float
    size: float


def hint_places(view: FlightView, hints: Iterable[KnownHint]) -> Mapping[int, HintPlace]:
    """By the id of the hint; those of frames that are not on the map any more are left out."""
    by_frame: dict[int, list[KnownHint]] = defaultdict(list)
    for hint in hints:
        by_frame[hint.found.frame].append(hint)
    found: dict[int, HintPlace] = {}
    for number, own in by_frame.items():
        painted, record = view.painted(number), view.frame(number)
        if painted is None or record is None or not record.width:
            continue
        scale = painted.camera.width / record.width
        pixels = (np.array([(one.found.x, one.found.y) for one in own]) + 0.5) * scale - 0.5
        places = places_of(painted, pixels)
        sizes = ground_sampling_distance(painted.pose, painted.camera, pixels) * scale
        for one, (x, y), size in zip(own, places, sizes, strict=True):
            if np.isfinite([x, y, size]).all():
                larger = max(one.found.width, one.found.height) * float(size)
                found[one.id] = HintPlace(painted.island, float(x), float(y), larger)
    return found
