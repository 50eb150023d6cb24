"""How an island was flown, by its pictures and its anchor: resolution, footprint, overlap, and how high."""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import median

import numpy as np

from gcs_mosaic.errors import UsageError
from gcs_mosaic.store.records import PositionRecord
from gcs_mosaic.views.flight_view import FlightView
from gcs_mosaic.views.focal_lengths import focal_deviation

# Of the log of the focal length: the height is as uncertain. Within ± 20 % (95 %) the overlap of a mission still holds: of 60 %
# at a footprint smaller by a fifth a half is left.
MOST_FOCAL_DEVIATION = 0.1
LEAST_OVERLAP, MOST_OVERLAP = 0.6, 0.85  # forward; what stitching needs at a border, and what no camera keeps up with


@dataclass(frozen=True, slots=True, kw_only=True)
class IslandSurvey:
    """The usual frame of an island. Lengths in metres.

    `gsd_m`: of a pixel on the ground; `side_m`: the shorter side of its footprint; `overlap`: forward, as a share; `height_m`: by
    the angle of view that was estimated, `height_deviation`: one standard deviation of its log, None while not estimated.
    """

    gsd_m: float
    side_m: float
    overlap: float
    height_m: float
    height_deviation: float | None

    @property
    def height_off(self) -> float:
        """How far the height may be off, as a share (95 %)."""
        return math.expm1(2 * (self.height_deviation or 0.0))

    def known_height(self, given_m: float | None) -> float:
        """The height over ground, as given or as the pictures tell. Raises UsageError if they do not."""
        if given_m is not None:
            return given_m
        if self.height_deviation is None or self.height_deviation > MOST_FOCAL_DEVIATION:
            off = (
                ""
                if self.height_deviation is None
                else f" but for a factor of {math.exp(2 * self.height_deviation):.1f}"
            )
            raise UsageError(
                f"How high it was flown is not known: the pictures do not tell the camera's angle of view{off} (level ground "
                "from one height never does). Give the height over ground as it was flown: --height METRES."
            )
        return self.height_m


def survey_of(view: FlightView, island: int, metres_per_unit: float) -> IslandSurvey:
    """Medians over an island's painted frames. Raises UsageError if there are none."""
    frames = [one for one in view.table().frames if one.island == island]
    if not frames:
        raise UsageError(f"Island {island} has no frame on the map.")
    gsd = {one.name: math.exp(one.pose.log_gsd) * metres_per_unit for one in frames}
    side = median(gsd[one.name] * min(one.camera.width, one.camera.height) for one in frames)
    return IslandSurvey(
        gsd_m=median(gsd.values()),
        side_m=side,
        overlap=_overlap(frames, side / metres_per_unit),
        height_m=median(gsd[one.name] * one.camera.focal_px for one in frames),
        height_deviation=focal_deviation(view, {one.name for one in frames}),
    )


def _overlap(frames: list[PositionRecord], side: float) -> float:
    """Of consecutive frames of one aircraft, by the way between their cameras; `side` in canvas units."""
    ways = []
    for vehicle in {one.vehicle for one in frames}:
        flown = sorted((one for one in frames if one.vehicle == vehicle), key=lambda one: one.order)
        places = np.array([(one.pose.x, one.pose.y) for one in flown])
        ways += np.hypot(*np.diff(places, axis=0).T).tolist()
    return float(np.clip(1 - median(ways) / side, LEAST_OVERLAP, MOST_OVERLAP)) if ways else LEAST_OVERLAP
