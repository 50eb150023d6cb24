"""When files appeared that were found late, because the program stood still (a suspended laptop) or the disk was slow.

A file found by a punctual scan has just appeared. Of files that one late scan finds, their own times tell, on whatever clock
they are: the usual difference is learnt from files found in time. Pure; time is passed in.
"""

from __future__ import annotations

from collections import deque
from statistics import median
from typing import NamedTuple

PUNCTUAL_S = 1.0  # a longer pause between two scans leaves it open when in between a file appeared
_LEARNT = 31  # files
_EARLY_S = 0.5  # tolerated beyond either end of the pause: file times may be coarse


class Pause(NamedTuple):
    """The time between two scans, in monotonic seconds: what the second finds appeared in between."""

    start: float
    end: float

    @property
    def is_short(self) -> bool:
        return self.end - self.start <= PUNCTUAL_S


class Appearances:
    """Dates the appearance of files."""

    def __init__(self) -> None:
        self._differences: deque[float] = deque(maxlen=_LEARNT)  # monotonic clock minus file time

    def dated(self, pause: Pause, modified: float, read_at: float, utc_of_zero: float) -> float:
        """When a file appeared that was found after `pause` and read at `read_at`; not known better: `read_at`.

        `modified` is its own time in seconds since 1970, `utc_of_zero` UTC at the monotonic clock's zero.
        """
        if pause.is_short:
            self._differences.append(read_at - modified)
            return read_at
        difference = median(self._differences) if self._differences else -utc_of_zero
        appeared = modified + difference
        if pause.start - _EARLY_S <= appeared <= pause.end + _EARLY_S:
            return min(max(appeared, pause.start), read_at)
        return read_at
