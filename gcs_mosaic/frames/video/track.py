"""Positions that a recording tells, by time within it. For anchors of the finished map only."""

from __future__ import annotations

import math
from bisect import bisect_left
from dataclasses import dataclass, field

from gcs_mosaic.messages import Position

FARTHEST_S = 1.0  # a receiver tells its position each second at least
MOST = 1_000_000  # positions: nine hours of 30 a second


def position_of(latitude_deg: float, longitude_deg: float, altitude_m: float | None) -> Position | None:
    """A position that can be one; None for what is written where there is none, such as 0, 0."""
    if not (abs(latitude_deg) <= 90 and abs(longitude_deg) <= 180):
        return None
    if abs(latitude_deg) < 1e-6 and abs(longitude_deg) < 1e-6:
        return None
    altitude = altitude_m if altitude_m is not None and math.isfinite(altitude_m) else None
    return Position(latitude_deg=latitude_deg, longitude_deg=longitude_deg, altitude_m=altitude)


@dataclass(slots=True)
class Track:
    """Positions in the order of their times (seconds from the video's beginning). `by`: what tells them."""

    by: str = ""
    _times: list[float] = field(default_factory=list)
    _positions: list[Position] = field(default_factory=list)

    def __len__(self) -> int:
        return len(self._times)

    def add(self, seconds: float, position: Position | None) -> None:
        """Leaves out what is not in order."""
        if position is not None and (not self._times or seconds > self._times[-1]) and len(self) < MOST:
            self._times.append(seconds)
            self._positions.append(position)

    def at(self, seconds: float) -> Position | None:
        """The position nearest in time; None if there is none near."""
        after = bisect_left(self._times, seconds)
        near = [k for k in (after - 1, after) if 0 <= k < len(self) and abs(self._times[k] - seconds) <= FARTHEST_S]
        return self._positions[min(near, key=lambda k: abs(self._times[k] - seconds))] if near else None
