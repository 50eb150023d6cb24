"""How far a sender's numbers and times behave like a counter and a clock; what does not is left out, and said. Pure."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from statistics import median

from gcs_mosaic.messages import TriggerEvent

_TOLD_BY = ("sequence", "source_time", "utc", "file_hint")  # fields that differ from shot to shot where they are kept
_JUDGED = 3  # shots after which it is said what a sender does not keep, and what has moved so often is kept
_MOST_RESENDS = 3  # of one shot, one after another: what comes more often is a sender that says the same of every shot
_STEPS = 12  # intervals by which a clock is judged
_LEAST_STEPS = 3
_DELAY_S = 4.0  # by which messages may be later or earlier than the one before: no fault of the clock
_RATE = (
    0.2  # by which the usual interval may differ: quartz differs by 0.00005, but a slow link's queue grows for minutes
)
_STILL_S, _STILL_FOR_S = 0.05, 1.0  # a clock that goes less than this in that time stands still: no shots are so close
_MOST_JUMPS = 3  # within the steps


@dataclass(slots=True)
class Conduct:
    """Of one stream: which of its fields have ever differed between two shots, and how often its last shot was repeated."""

    moved: Counter[str] = field(default_factory=Counter)  # how often
    shots: int = 0
    _last: TriggerEvent | None = None
    _repeats: int = 0
    _repeated: float = 0.0

    def shot(self, event: TriggerEvent) -> None:
        """A message about a shot of which this sender has not told before."""
        if self._last is not None:
            self.moved.update(one for one in _TOLD_BY if getattr(event, one) != getattr(self._last, one))
        self._last, self._repeated, self._repeats = event, event.received, 0
        self.shots += 1

    def repeated(self, event: TriggerEvent, apart_s: float) -> None:
        """A message that counts as a repetition; those closer than `apart_s` to the one before came by two ways."""
        if self._last is None or event.sequence != self._last.sequence:
            self._repeats = 0
            return
        self._repeats += event.received - self._repeated > apart_s
        self._repeated = event.received

    def tells_by(self, name: str) -> bool:
        """Whether a field that is the same in two messages says that they are about one shot."""
        return self.moved[name] >= _JUDGED or (name in self.moved and self._repeats < _MOST_RESENDS)

    @property
    def is_stuck(self) -> bool:
        """Whether several shots had one number, and none another."""
        return self.shots >= 2 and "sequence" not in self.moved

    def faults(self) -> Iterator[tuple[str, str]]:
        """What it does not keep, by kind, in words for the operator."""
        if self.shots < _JUDGED or self._last is None:
            return
        if "sequence" not in self.moved:
            number = "no number" if self._last.sequence is None else f"the number {self._last.sequence} every time"
            yield "counter", f"gives its shots {number}: they are told apart by time and file name alone"
        if self._last.source_time is None and "source_time" not in self.moved:
            yield "time", "tells no times: its shots are dated by when its messages come"


@dataclass(slots=True)
class Pace:
    """Whether a clock goes as fast as ours, by the times it told, when they came, and what was then known of its offset."""

    _told: deque[tuple[float, float, float]] = field(default_factory=lambda: deque(maxlen=_STEPS + 1))
    _jumps: deque[bool] = field(default_factory=lambda: deque(maxlen=_STEPS))

    def heard(self, source_time: float, received: float, offset: float, *, jumped: bool) -> None:
        """The clock told `source_time` in a message that came at `received`; `jumped`: as no delay explains. `offset`: from it
        to ours, by the quickest message so far."""
        self._told.append((source_time, received, offset))
        self._jumps.append(jumped)

    def fault(self) -> str | None:
        """Why the clock is not believed at present, in words for the operator."""
        if sum(self._jumps) >= _MOST_JUMPS:
            return "jumps"
        if (rate := self._rate()) is not None:
            return f"goes {rate:.3g} s in a second" if rate > 0 else "goes backwards or stands still"
        return "stands still" if self._stands_still() else None

    def _rate(self) -> float | None:
        """Its usual rate, if that is far from 1 and adds up to more than what delays can do.

        An outage of the link is a single slow step; what it held back are fast ones, but none is ahead of the quickest message.
        """
        told = list(self._told)
        if len(told) <= _LEAST_STEPS:
            return None
        steps = [(b[0] - a[0], b[1] - a[1]) for a, b in pairwise(told)]
        usual = median(gone / passed if passed > 0.01 else 100.0 for gone, passed in steps)
        behind = (told[-1][1] - told[0][1]) - (told[-1][0] - told[0][0])
        excess = told[0][2] - told[-1][2] if usual > 1 else behind
        return usual if abs(usual - 1) > _RATE and excess > _DELAY_S else None

    def _stands_still(self) -> bool:
        if len(self._told) < 2:
            return False
        (before, came_before, _), (now, came, _) = self._told[-2], self._told[-1]
        return abs(now - before) < _STILL_S and came - came_before > _STILL_FOR_S
