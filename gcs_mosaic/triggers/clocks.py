"""Maps the clocks of event sources to the host's monotonic clock. Pure."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Hashable
from dataclasses import dataclass, field

from gcs_mosaic.messages import FEEDBACK_WRAP_S, Source, Teller, TriggerEvent, unwrapped
from gcs_mosaic.triggers.conduct import Pace

JUMP_S = 5.0  # further above the envelope than this: a delayed message, or a clock jump
SAME_CLOCK_S = 0.5  # two late messages agree this well only if the clock itself has jumped
SAME_CLOCK_AFTER_S = 1.0  # ... and only if they did not arrive in one burst
_MOST_CLOCKS = 64  # no link has as many sources, but a forger might
DRIFT = 1e-4  # seconds per second; quartz is good to 20-50 ppm


@dataclass(slots=True)
class OffsetClock:
    """One remote clock; its offset is the lower envelope of received − source time, because delays are positive.

    A clock that jumps (GPS fix) is followed: forwards at once, backwards when two messages that arrived apart agree, so that a
    single delayed message changes nothing; one that begins anew (reboot) at once. Wrap-around is unwrapped.
    """

    offset: float | None = None
    wrap_s: float | None = None  # period after which the clock wraps
    paces: dict[int, Pace] = field(default_factory=dict)  # by camera: several of one sender may tell of one moment
    _updated: float = 0.0
    _suspect: tuple[float, float] | None = None
    _latest: float | None = None  # source time

    def moment(self, source_time: float, received: float, camera: int = 0) -> float:
        """Time of the event in seconds of the host's monotonic clock; never later than `received`."""
        if self.wrap_s is not None and self.offset is not None:
            source_time = unwrapped(source_time, received - self.offset, self.wrap_s)
        sample = received - source_time
        if self.offset is not None:
            self.offset += DRIFT * max(0.0, received - self._updated)
        has_begun = self._has_begun_anew(source_time, received)
        before, leapt = self.offset, self._has_leapt(sample, received) or has_begun
        if self.offset is None or sample <= self.offset or leapt:
            self.offset = sample
        ahead = before is not None and before - sample > JUMP_S
        self.paces.setdefault(camera, Pace()).heard(source_time, received, self.offset, jumped=leapt or ahead)
        self._updated = received
        self._latest = source_time if leapt or self._latest is None else max(self._latest, source_time)
        return source_time + self.offset

    def _has_begun_anew(self, source_time: float, received: float) -> bool:
        """Whether it tells less than before, and no more than has passed since: what comes late is of longer after the start."""
        has_fallen = self._latest is not None and source_time < self._latest - JUMP_S
        return has_fallen and 0 <= source_time <= received - self._updated + JUMP_S

    def _has_leapt(self, sample: float, received: float) -> bool:
        if self.offset is None or sample - self.offset <= JUMP_S:
            self._suspect = None
            return False
        if self._suspect is None or abs(sample - self._suspect[0]) > SAME_CLOCK_S:
            self._suspect = (sample, received)
            return False
        return received - self._suspect[1] >= SAME_CLOCK_AFTER_S


class SourceClocks:
    """One clock offset per source of timestamped events. `faults`: why a source's clock is not believed at present."""

    def __init__(self) -> None:
        self._clocks: OrderedDict[Hashable, OffsetClock] = OrderedDict()
        self.faults: dict[Teller, str] = {}

    def moment(self, event: TriggerEvent) -> float:
        """Time of the event on the host's monotonic clock; its arrival if it carries no timestamp, or none to be believed."""
        if event.source_time is None or event.clock == "none":
            return event.received
        key = (event.teller, event.clock)
        wraps = event.source is Source.CAMERA_FEEDBACK and event.clock == "boot"
        clock = self._clocks.setdefault(key, OffsetClock(wrap_s=FEEDBACK_WRAP_S if wraps else None))
        self._clocks.move_to_end(key)
        if len(self._clocks) > _MOST_CLOCKS:
            self._clocks.popitem(last=False)
        came = event.received if event.latest is None else event.latest
        moment = clock.moment(event.source_time, came, event.camera)
        fault = clock.paces[event.camera].fault()
        self.faults.pop(event.teller, None)
        if fault is None:
            return moment
        self.faults[event.teller] = fault
        return event.received
