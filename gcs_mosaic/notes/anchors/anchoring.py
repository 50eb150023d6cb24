"""The anchor of each island, of the pins that people have set or the positions that they have asked for.

Pins are worth more than positions: an island with pins of two points or more is laid by them alone. Each island has its own
anchor, and one that is known helps nobody else's.
"""

from __future__ import annotations

import logging
import math
import threading
from collections import Counter, defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from typing import TYPE_CHECKING, Literal, TypeVar

import numpy as np

from gcs_mosaic.errors import UsageError
from gcs_mosaic.geo.anchor import Anchor
from gcs_mosaic.geo.pins import Pin, PinnedMap, Refused, anchored_by_pins
from gcs_mosaic.geo.points import number_of_points
from gcs_mosaic.geo.positions import PositionedMap, ShotPosition, anchored_by_positions
from gcs_mosaic.notes.anchors.pins import SetPin
from gcs_mosaic.notes.anchors.scales import IslandScale
from gcs_mosaic.notes.ground.binding import GroundFollower, GroundPlace
from gcs_mosaic.notes.ground.places import GeoPlace
from gcs_mosaic.views.flight_view import FlightView

if TYPE_CHECKING:
    from gcs_mosaic.messages import Teller
    from gcs_mosaic.stitch.camera.geometry import Pose
    from gcs_mosaic.store.records import ReportedPosition

Told = TypeVar("Told")

logger = logging.getLogger(__name__)

LEAST_POINTS = 2


@dataclass(frozen=True, slots=True)
class IslandAnchor:
    """How an island is laid, or why it is not. `pins`: those on it, with `result.residuals_m` in their order."""

    island: int
    by: Literal["pins", "positions"]
    result: PinnedMap | PositionedMap | Refused
    pins: tuple[SetPin, ...] = ()

    @property
    def anchor(self) -> Anchor | None:
        return None if isinstance(self.result, Refused) else self.result.anchor


class Anchoring:
    """The anchors of a flight. Thread-safe; what they were computed of is compared, so that asking often costs little."""

    def __init__(self, view: FlightView, follower: GroundFollower) -> None:
        self._view, self._follower = view, follower
        self._lock = threading.Lock()
        self._known: tuple[object, Mapping[int, IslandAnchor]] = (None, {})

    def islands(self, pins: Sequence[SetPin], *, by_positions: bool) -> Mapping[int, IslandAnchor]:
        """By island; those without a pin and without positions that were asked for are absent."""
        asked = (self._view.table().revision, tuple(pins), by_positions)
        with self._lock:
            if self._known[0] != asked:
                self._known = asked, self._fitted(pins, by_positions)
            return self._known[1]

    def _fitted(self, pins: Sequence[SetPin], by_positions: bool) -> Mapping[int, IslandAnchor]:
        errors = self._map_errors()
        found: dict[int, IslandAnchor] = {}
        if by_positions:
            for island, shots in self._shots().items():
                found[island] = IslandAnchor(island, "positions", anchored_by_positions(shots, errors.get(island, 0.0)))
        for island, (its_pins, places) in self._by_island(pins).items():
            placed = [_pin(*one) for one in zip(its_pins, places, strict=True)]
            if island not in found or number_of_points(placed) >= LEAST_POINTS:
                result = anchored_by_pins(placed, errors.get(island, 0.0))
                found[island] = IslandAnchor(island, "pins", result, tuple(its_pins))
        return found

    def _by_island(self, pins: Sequence[SetPin]) -> dict[int, tuple[list[SetPin], list[GroundPlace]]]:
        found: dict[int, tuple[list[SetPin], list[GroundPlace]]] = defaultdict(lambda: ([], []))
        for pin in pins:
            if not pin.deleted:
                place = self._follower.place(pin.pin.binding)
                found[place.island][0].append(pin)
                found[place.island][1].append(place)
        return found

    def _map_errors(self) -> dict[int, float]:
        """What each island may be bent by, one standard deviation in canvas units: that of a usual frame's worst corner."""
        deviations: dict[int, list[float]] = defaultdict(list)
        for island, units in _read(self._view.corner_deviations):
            deviations[island].append(units)
        return {island: median(units) for island, units in deviations.items()}

    def _shots(self) -> dict[int, list[ShotPosition]]:
        """The positions that were told of painted frames, by island; of each island those of who tells most of it: two senders
        have clocks of their own, and two aircraft cameras."""
        frames = {one.number: one for one in self._view.table().frames}
        told: dict[int, list[ReportedPosition]] = defaultdict(list)
        for one in _read(self._view.reported_positions):
            if one.frame in frames:
                told[frames[one.frame].island].append(one)
        return {
            island: [_shot(one, frames[one.frame].pose) for one in of_one(its_own)] for island, its_own in told.items()
        }


def _shot(told: ReportedPosition, pose: Pose) -> ShotPosition:
    return ShotPosition(
        time_s=told.received if told.source_time is None else told.source_time,
        x=pose.x,
        y=pose.y,
        longitude_deg=told.position.longitude_deg,
        latitude_deg=told.position.latitude_deg,
    )


def anchor_of(islands: Mapping[int, IslandAnchor]) -> Callable[[GroundPlace], GeoPlace | None]:
    """What tells a canvas place's longitude, latitude and error; None where its island has no anchor."""

    def told(place: GroundPlace) -> GeoPlace | None:
        laid = islands.get(place.island)
        return None if laid is None or laid.anchor is None else geo_place(laid.anchor, place.x, place.y)

    return told


def anchored(islands: Mapping[int, IslandAnchor]) -> list[IslandScale]:
    """The scales that anchors tell."""
    return [
        IslandScale(island=one.island, metres_per_unit=one.anchor.metres_per_unit, source="anchor", scale=None)
        for one in islands.values()
        if one.anchor is not None
    ]


def geo_place(anchor: Anchor, x: float, y: float) -> GeoPlace | None:
    """A canvas place's longitude, latitude and the longer half axis of its error (95 %); None too far from the map."""
    longitude, latitude = map(float, anchor.places(np.array([x, y])))
    return GeoPlace(longitude, latitude, anchor.error(x, y).major_m) if math.isfinite(longitude) else None


def most_telling(told: Sequence[ReportedPosition]) -> Teller:
    """Who has told most positions; of the same number the more authoritative."""
    counts = Counter(one.teller for one in told)
    return max(counts, key=lambda teller: (counts[teller], teller.source))


def of_one(told: Sequence[ReportedPosition]) -> list[ReportedPosition]:
    """Those of who tells most."""
    teller = most_telling(told)
    return [one for one in told if one.teller == teller]


def _read(question: Callable[[], Sequence[Told]]) -> Sequence[Told]:
    """What a ledger tells; nothing where there is none that can be read."""
    try:
        return question()
    except UsageError:
        logger.info("no ledger can be read", exc_info=True)
        return []


def _pin(pin: SetPin, place: GroundPlace) -> Pin:
    new = pin.pin
    return Pin(pin.name, place.x, place.y, new.longitude_deg, new.latitude_deg, new.sigma_m)
