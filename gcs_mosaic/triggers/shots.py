"""Merges several messages about one shot. Pure; event ids are the caller's.

One picture may be announced by the autopilot (112, 180, 263) and by the camera (263), over two links, and again on request.
Messages of one source carry a sequence number, so repetitions are recognised exactly. Two sources count independently:
the learnt offset between their counters decides; time decides only while that is unknown.
"""

from __future__ import annotations

import threading
from collections import OrderedDict, deque
from collections.abc import Callable, Hashable, Iterator
from dataclasses import dataclass, field
from typing import Any, TypeAlias, TypeVar

from gcs_mosaic.messages import Notice, Source, Teller, TriggerEvent
from gcs_mosaic.triggers.clocks import SourceClocks
from gcs_mosaic.triggers.conduct import Conduct
from gcs_mosaic.triggers.counters import Counters, StreamKey

_RECENT = 16  # shots that may still lie within the window; no camera takes more a second
_MOST_TELLING = 4  # streams about the shots within the window; of more, as in a flood, time cannot tell which is meant
_MOST_UNPROVEN = (
    3  # shots within the window that only unproven sources tell of; more are a flood, or a burst with a counter
)
MOST_SHOTS = 1 << 16  # shots that a message may still refer to: above `remembered` times `_MOST_STREAMS`
_MOST_STREAMS = 32  # sources with a counter; no aircraft has as many, but a forger might
_MOST_AIRCRAFT = 32  # remembered, those heard last; ids can be forged
_MOST_SAID = 8  # remarks on the senders of one aircraft: ids can be forged
LINKS_APART_S = 3.0  # by which one message comes later over the slower of two links


@dataclass(frozen=True, slots=True, kw_only=True)
class ShotSettings:
    """How messages about one shot are merged. Times are in seconds."""

    window_s: float = 1.0
    """Messages of two sources this close mean one shot where no counter decides; shots are rarely closer."""
    index_window_s: float = 30.0
    """How late a second message about a shot may arrive if the counters match."""
    resend_s: float = 60.0
    """A repeated sequence number without a timestamp is a repetition for this long; later the counter was reset."""
    remembered: int = 1024
    """Messages kept per source to recognise repetitions: eight minutes at two shots a second."""


@dataclass(frozen=True, slots=True)
class New:
    """A new shot. `moment`: when it was taken, in seconds of the host's monotonic clock."""

    moment: float = field(default=0.0, compare=False)


@dataclass(frozen=True, slots=True)
class Duplicate:
    """A repetition about the shot whose first event has the id `of`."""

    of: int


@dataclass(frozen=True, slots=True)
class Better:
    """A more authoritative message about the shot whose first event has the id `of`: use its fields from now on."""

    of: int


Verdict: TypeAlias = New | Duplicate | Better


@dataclass(frozen=True, slots=True)
class CameraMessage:
    """An event and its verdict; `number` counts all messages, and the verdict's `of` refers to such a number."""

    number: int
    event: TriggerEvent
    verdict: Verdict


T = TypeVar("T")


class Shots:
    """The one place where messages about shots are merged and dated, for all links. Thread-safe.

    `credible`: the sources whose shots have proved true.
    """

    def __init__(self, settings: ShotSettings, credible: Callable[[], frozenset[Teller]] = frozenset) -> None:
        self._settings = settings
        self._mergers: OrderedDict[int, ShotMerger] = OrderedDict()  # by aircraft: they share no counter and no clock
        self._credible = credible
        self._lock = threading.Lock()
        self._heard = 0

    def hear(self, event: TriggerEvent) -> CameraMessage:
        """Number and classify an event."""
        with self._lock:
            self._heard += 1
            verdict = self._merger_of(event.vehicle).add(self._heard, event, self._credible())
            return CameraMessage(self._heard, event, verdict)

    def news(self, event: TriggerEvent) -> list[Notice]:
        """What is to be said of an event's sender, each once: it counts or dates its shots as nobody can believe."""
        with self._lock:
            texts = list(self._merger_of(event.vehicle).news(event))
        return [Notice(source="triggers", level="warning", text=text) for text in texts]

    def _merger_of(self, vehicle: int) -> ShotMerger:
        if vehicle not in self._mergers:
            self._mergers[vehicle] = ShotMerger(self._settings)
        self._mergers.move_to_end(vehicle)
        if len(self._mergers) > _MOST_AIRCRAFT:
            self._mergers.popitem(last=False)
        return self._mergers[vehicle]

    def follow(self, items: Iterator[T | TriggerEvent]) -> Iterator[T | CameraMessage | Notice]:
        """A link's items, with each event replaced by its CameraMessage, and what is to be said of its sender."""
        for item in items:
            if isinstance(item, TriggerEvent):
                yield self.hear(item)
                yield from self.news(item)
            else:
                yield item


@dataclass(slots=True, eq=False)
class _Shot:
    id: int
    moment: float
    best: Source
    told: dict[StreamKey, int | None] = field(default_factory=dict)  # sequence number in each stream
    tellers: set[Teller] = field(default_factory=set)

    def told_by(self, source: Source) -> bool:
        return any(key.source == source for key in self.told)


class ShotMerger:
    """Classifies each event: a new shot, a repetition, or a more authoritative message about a known one."""

    def __init__(self, settings: ShotSettings | None = None) -> None:
        self._settings = settings or ShotSettings()
        self._clocks = SourceClocks()
        self._counters = Counters(self._settings.window_s)
        # By number, and by number and file name: a camera that cannot count may still name its files.
        self._seen: dict[StreamKey, OrderedDict[Hashable, tuple[TriggerEvent, _Shot]]] = {}
        self._conduct: dict[StreamKey, Conduct] = {}
        self._said: dict[tuple[StreamKey, str], None] = {}
        self._recent: deque[_Shot] = deque(maxlen=_RECENT)

    def add(self, event_id: int, event: TriggerEvent, credible: frozenset[Teller] = frozenset()) -> Verdict:
        """Classify `event`. Its id becomes the shot's if the shot is new. `credible`: see `Shots`."""
        key = StreamKey(event.vehicle, event.component, event.camera, event.source)
        seen, conduct = self._seen.setdefault(key, OrderedDict()), self._conduct.setdefault(key, Conduct())
        before = seen.get((event.sequence, event.file_hint)) or seen.get(event.sequence)
        if before and self._is_resent(before[0], event, conduct):
            conduct.repeated(event, self._settings.window_s)
            return Duplicate(before[1].id)
        conduct.shot(event)
        moment = self._clocks.moment(event)
        shot = self._same_shot(key, event, moment, credible)
        verdict = _verdict(shot, event, moment)
        if shot is None:
            shot = _Shot(event_id, moment, event.source)
            self._recent.append(shot)
        self._remember(key, event, shot)
        return verdict

    def news(self, event: TriggerEvent) -> Iterator[str]:
        """What this event's sender does not keep, in words for the operator, each once."""
        key = StreamKey(event.vehicle, event.component, event.camera, event.source)
        faults = list(self._conduct[key].faults()) if key in self._conduct else []
        if fault := self._clocks.faults.get(event.teller):
            faults.append(("clock", f"has a clock that {fault}: its shots are dated by when its messages come"))
        for kind, text in faults:
            if (key, kind) not in self._said and len(self._said) < _MOST_SAID:
                self._said[key, kind] = None
                yield f"{event.teller} {text}"

    def _is_resent(self, before: TriggerEvent, event: TriggerEvent, conduct: Conduct) -> bool:
        """Whether two messages of one sender with one number are about one shot.

        What never differs between its shots tells nothing: then only time does, as of one message that came by two ways.
        """
        if before.result != event.result:  # not every camera's counter advances on a failed capture
            return False
        if before.file_hint and event.file_hint and before.file_hint != event.file_hint:
            return False
        late_s, same_time = event.received - before.received, _same(before.source_time, event.source_time)
        if same_time and conduct.tells_by("source_time"):
            return True
        if same_time and event.clock == "boot" and _same(before.utc, event.utc):
            return True  # two clocks are not both stuck, and the first shot of all may be told again, too
        timeless = before.source_time is None and event.source_time is None
        alike = (timeless and conduct.tells_by("sequence")) or any(
            _same(getattr(before, name), getattr(event, name)) and conduct.tells_by(name)
            for name in ("utc", "file_hint")
        )
        if alike:
            return late_s <= self._settings.resend_s
        return late_s <= (LINKS_APART_S if same_time else self._settings.window_s) and (same_time or timeless)

    def _same_shot(
        self, key: StreamKey, event: TriggerEvent, moment: float, credible: frozenset[Teller]
    ) -> _Shot | None:
        sequence, nearest = event.sequence, self._nearest_in_time(key, event, moment, credible)
        if sequence is None or self._conduct[key].is_stuck:
            return nearest
        self._counters.heard(key, sequence, moment)
        expected = self._counters.expected(key, sequence)
        for other, count in expected.items():
            _, shot = self._seen[other].get(count, (None, None))
            if shot and not shot.told_by(key.source) and abs(moment - shot.moment) <= self._settings.index_window_s:
                return shot
        return nearest if nearest and not _contradicts(expected, nearest) else None

    def _nearest_in_time(
        self, key: StreamKey, event: TriggerEvent, moment: float, credible: frozenset[Teller]
    ) -> _Shot | None:
        candidates = [
            shot
            for shot in self._recent
            if abs(shot.moment - moment) <= self._settings.window_s and not shot.told_by(key.source)
            if all(other.vehicle == key.vehicle for other in shot.told)
        ]
        if len({other for shot in candidates for other in shot.told}) > _MOST_TELLING:
            return None
        if event.teller in credible:
            unproven = [shot for shot in candidates if credible.isdisjoint(shot.tellers)]
            if len(unproven) > _MOST_UNPROVEN:
                candidates = [shot for shot in candidates if shot not in unproven]
        return min(candidates, key=lambda shot: abs(shot.moment - moment), default=None)

    def _remember(self, key: StreamKey, event: TriggerEvent, shot: _Shot) -> None:
        shot.told[key] = event.sequence
        shot.tellers.add(event.teller)
        shot.best = max(shot.best, event.source)
        seen = self._seen[key]
        for known in (event.sequence, (event.sequence, event.file_hint)):
            seen[known] = (event, shot)
            seen.move_to_end(known)
        while len(seen) > 2 * self._settings.remembered:
            seen.popitem(last=False)
        if len(self._seen) > _MOST_STREAMS:
            oldest = next(iter(self._seen))
            del self._seen[oldest], self._conduct[oldest]
            self._counters.forget(oldest)


def _contradicts(expected: dict[StreamKey, int], shot: _Shot) -> bool:
    return any(key in expected and count != expected[key] for key, count in shot.told.items())


def _verdict(shot: _Shot | None, event: TriggerEvent, moment: float) -> Verdict:
    if shot is None:
        return New(moment)
    return Better(shot.id) if event.source > shot.best else Duplicate(shot.id)


def _same(one: Any, other: Any) -> bool:
    return one is not None and one == other
