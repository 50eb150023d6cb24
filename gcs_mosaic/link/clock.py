"""Other people's clocks: what they count from, and where they stand on the host's monotonic clock. Pure."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from typing import Literal

from gcs_mosaic.events import Source, TriggerEvent

Clock = Literal["boot", "epoch", "none"]

EPOCH_FROM_S = 1e9  # 2001 in seconds since 1970, or 31 years of uptime
SANE_UTC_S = (1.4e9, 4.1e9)  # 2014 to 2099; real logs claim the year 2908, or 1970 without a GPS fix

JUMP_S = 5.0  # later than the envelope by more than this: a delayed message, or another clock
SAME_CLOCK_S = 0.5  # two late messages agree this well only if the clock itself has moved
SAME_CLOCK_AFTER_S = 1.0  # ... and only if they did not come in one burst
FEEDBACK_WRAP_S = 2**32 / 1e6  # ArduPilot counts CAMERA_FEEDBACK's time since boot in 32 bits of microseconds
DRIFT = 1e-4  # seconds per second; quartz is good to 20-50 ppm


def clock_of(seconds: float) -> Clock:
    """What a time counts from, told by its magnitude: zero and below mean that the sender did not know."""
    if not seconds > 0:
        return "none"
    return "epoch" if seconds >= EPOCH_FROM_S else "boot"


def plausible_utc(seconds: float) -> float | None:
    """`seconds` since 1970 if a flight could have happened then."""
    return seconds if SANE_UTC_S[0] <= seconds <= SANE_UTC_S[1] else None


def unwrapped(seconds: float, expected: float, wrap_s: float) -> float:
    """`seconds` on a clock that begins anew every `wrap_s`, as one that goes on: what is nearest to `expected`."""
    return seconds + wrap_s * round((expected - seconds) / wrap_s)


@dataclass(slots=True)
class OffsetClock:
    """One foreign clock; its offset is the lower envelope of received − source time, because delays only add.

    A clock that leaps (reboot, a GPS fix) is followed: forwards at once, backwards when two messages that did not come
    together agree, so that one message that was held up changes nothing. One that wraps is known to.
    """

    offset: float | None = None
    wrap_s: float | None = None  # the clock begins anew every so many seconds
    _updated: float = 0.0
    _suspect: tuple[float, float] | None = None

    def moment(self, source_time: float, received: float) -> float:
        """When it happened, in seconds of the host's monotonic clock; never later than `received`."""
        if self.wrap_s is not None and self.offset is not None:
            source_time = unwrapped(source_time, received - self.offset, self.wrap_s)
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
        wraps = event.source is Source.CAMERA_FEEDBACK and event.clock == "boot"
        clock = self._clocks.setdefault(key, OffsetClock(wrap_s=FEEDBACK_WRAP_S if wraps else None))
        return clock.moment(event.source_time, event.received)
