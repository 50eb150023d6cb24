"""Other people's clocks: what they count from, and where they stand on the host's monotonic clock. Pure."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from typing import Literal

from gcs_mosaic.events import TriggerEvent

Clock = Literal["boot", "epoch", "none"]

EPOCH_FROM_S = 1e9  # 2001 in seconds since 1970, or 31 years of uptime
SANE_UTC_S = (1.4e9, 4.1e9)  # 2014 to 2099; real logs claim the year 2908, or 1970 without a GPS fix

JUMP_S = 5.0  # later than the envelope by more than this: a delayed message, or another clock
SAME_CLOCK_S = 0.5  # two late messages agree this well only if the clock itself has moved
SAME_CLOCK_AFTER_S = 1.0  # ... and only if they did not come in one burst
DRIFT = 1e-4  # seconds per second; quartz is good to 20-50 ppm


def clock_of(seconds: float) -> Clock:
    """What a time counts from, told by its magnitude: zero and below mean that the sender did not know."""
    if not seconds > 0:
        return "none"
    return "epoch" if seconds >= EPOCH_FROM_S else "boot"


def plausible_utc(seconds: float) -> float | None:
    """`seconds` since 1970 if a flight could have happened then."""
    return seconds if SANE_UTC_S[0] <= seconds <= SANE_UTC_S[1] else None


@dataclass(slots=True)
class OffsetClock:
    """One foreign clock; its offset is the lower envelope of received − source time, because delays only add.

    A clock that leaps (reboot, the 71.6-minute wrap, a GPS fix) is followed: forwards at once, backwards when two
    messages that did not come together agree, so that one message that was held up changes nothing.
    """

    offset: float | None = None
    _updated: float = 0.0
    _suspect: tuple[float, float] | None = None

    def moment(self, source_time: float, received: float) -> float:
        """When it happened, in seconds of the host's monotonic clock; never later than `received`."""
        sample = received - source_time
        if self.offset is not None:
            self.offset += DRIFT * max(0.0, received - self._updated)
        if self.offset is None or sample <= self.offset or self._has_leapt(sample, received):
            self.offset = sample
        self._updated = received
        return source_time + self.offset

    def _has_leapt(self, sample: float, received: float) -> bool:
        if self.offset is None or sample - self.offset <= JUMP_S:
            self._suspect = None
            return False
        if self._suspect is None or abs(sample - self._suspect[0]) > SAME_CLOCK_S:
            self._suspect = (sample, received)
            return False
        return received - self._suspect[1] >= SAME_CLOCK_AFTER_S


class SourceClocks:
    """An offset for every source of events that has a clock."""

    def __init__(self) -> None:
        self._clocks: dict[Hashable, OffsetClock] = {}

    def moment(self, event: TriggerEvent) -> float:
        """When the event happened on the host's monotonic clock; its arrival if it carries no time."""
        if event.source_time is None or event.clock == "none":
            return event.received
        key = (event.vehicle, event.component, event.source, event.clock)
        return self._clocks.setdefault(key, OffsetClock()).moment(event.source_time, event.received)
