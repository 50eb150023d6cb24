"""Frames without triggers: at a fixed interval, or whenever the view has moved."""

from __future__ import annotations

import math
import re
from typing import Literal

from gcs_mosaic.frames.rtsp.motion import ViewMotion
from gcs_mosaic.frames.rtsp.ring_buffer import StreamPicture

SHORTEST_S = 0.1  # more frames than that do not improve a map
LOOK_EACH_S = 0.15  # how often view motion is measured: a few milliseconds each
LOST_EACH_S = 0.5  # how often a frame is taken of a view that cannot be followed: calm water, fog, a lens cap


def parse_every(text: str) -> float | Literal["overlap"]:
    """Seconds between frames, or "overlap". Raises ValueError for anything else."""
    words = text.strip().lower()
    if words == "overlap":
        return "overlap"
    seconds = re.fullmatch(r"(\d{1,5}(?:\.\d{1,3})?)\s*s?", words, re.ASCII)
    if seconds and float(seconds[1]) >= SHORTEST_S:
        return float(seconds[1])
    raise ValueError(f"every: expected overlap or seconds from {SHORTEST_S:g} on, such as 1 s, got {text!r}")


class Wishes:
    """Decides for each newest image in turn whether to take it."""

    def __init__(self, every: str | None, moved: float) -> None:
        """`every` as in the settings; `moved` is the share that must be new."""
        self._every = None if every is None else parse_every(every)
        self._moved = moved
        self._motion = ViewMotion()
        self._looked: float | None = None  # time of the last measurement
        self._taken: float | None = None  # time of the last frame that motion asked for

    @property
    def described(self) -> str:
        """When frames are taken without a trigger, for display; empty if never."""
        if self._every is None:
            return ""
        if self._every == "overlap":
            return f"whenever {self._moved:.0%} of the view is new"
        return f"every {self._every:g} s"

    def moment(self, newest: StreamPicture) -> float | None:
        """The time for which a frame is wanted, if one is wanted now."""
        if self._every is None:
            return None
        moment = newest.moment
        if self._every == "overlap":
            return moment if self._is_time(moment, LOOK_EACH_S) and self._has_moved(newest) else None
        return moment if self._is_time(moment, self._every) else None

    def go_on(self, picture: StreamPicture) -> None:
        """An earlier run has taken a frame of this image's time: go on from it."""
        moment = picture.moment
        if self._every == "overlap":
            self._motion.new_share(picture.grey())
            self._take(moment)
        elif self._every is not None:
            self._looked = self._every * math.floor(moment / self._every + 1e-6)

    def _is_time(self, moment: float, interval_s: float) -> bool:
        """Keeps pace: a slightly late image does not delay all later ones."""
        passed = None if self._looked is None else moment - self._looked
        if passed is not None and 0 <= passed < interval_s:
            return False
        in_pace = passed is not None and interval_s <= passed < 2 * interval_s
        self._looked = self._looked + interval_s if in_pace and self._looked is not None else moment
        return True

    def _has_moved(self, picture: StreamPicture) -> bool:
        moment = picture.moment
        if self._motion.new_share(picture.grey()) < self._moved:
            return False
        is_soon = self._taken is not None and 0 <= moment - self._taken < LOST_EACH_S
        if self._motion.is_lost and is_soon:
            return False
        self._take(moment)
        return True

    def _take(self, moment: float) -> None:
        """From here on everything follows from this image alone."""
        self._motion.taken()
        self._looked = self._taken = moment
