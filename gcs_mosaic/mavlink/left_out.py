"""Triggers of aircraft that are not followed, kept for a while: the operator may choose one of them yet. Pure."""

from __future__ import annotations

from collections import Counter, OrderedDict, deque

from gcs_mosaic.messages import TriggerEvent

KEPT_S = 60.0  # as long as a frame may take: those of older triggers have been given up
_MOST_EVENTS = 200  # of each system: a minute at three a second
_MOST_SYSTEMS = 8  # ids can be forged


class LeftOut:
    """The newest triggers of each system, and how many there were; the system silent longest is forgotten."""

    def __init__(self) -> None:
        self.counts: Counter[int] = Counter()
        self._kept: OrderedDict[int, deque[TriggerEvent]] = OrderedDict()

    def keep(self, event: TriggerEvent) -> None:
        """Count and keep one."""
        self.counts[event.vehicle] += 1
        self._kept.setdefault(event.vehicle, deque(maxlen=_MOST_EVENTS)).append(event)
        self._kept.move_to_end(event.vehicle)
        if len(self._kept) > _MOST_SYSTEMS:
            self._kept.popitem(last=False)

    def take(self, system: int, now: float) -> list[TriggerEvent]:
        """Those of `system` whose frames may still come, oldest first; they are no longer left out."""
        kept = self._kept.pop(system, ())
        recent = [one for one in kept if now - one.received <= KEPT_S]
        self.counts[system] -= len(recent)
        self.counts += Counter()  # drops what is zero
        return recent
