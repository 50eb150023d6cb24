"""Which aircraft is followed: the first to trigger a camera, until it is gone or the operator chooses another. No I/O.

Where several fly, all of them count, and none is followed.
"""

from __future__ import annotations

import threading
from collections import Counter, OrderedDict, deque
from collections.abc import Iterator

from gcs_mosaic.mavlink.settings import AircraftIds, LinkSettings
from gcs_mosaic.messages import TriggerEvent

MOST_AIRCRAFT = 16  # of `all`: system ids can be forged
MOST_TOLD = 8  # others in a sentence
KEPT_S = 60.0  # as long as a frame may take: those of older triggers have been given up
_MOST_EVENTS = 200  # of each system: a minute at three a second
_MOST_SYSTEMS = 8  # ids can be forged


class VehicleChoice:
    """The one aircraft whose triggers are used; shared by all links, so that they agree on it. Thread-safe.

    All times are arrival times in monotonic seconds, so silence is judged by what was heard meanwhile: a program that stood
    still, and has yet to read what the kernel holds, releases nobody.
    """

    def __init__(self, settings: LinkSettings | None = None) -> None:
        self._settings = settings or LinkSettings()
        self._lock = threading.Lock()
        self._followed = self._settings.vehicle
        self._asked = self._followed is not None  # chosen by the operator, and never released
        self._heard: dict[int, float] = {}  # by system id, as are the following
        self._autopilots: set[int] = set()
        self._first_trigger: dict[int, float] = {}
        self._last_trigger: dict[int, float] = {}
        self._latest = 0.0
        self._named: AircraftIds = ()  # of several
        self._counted: set[int] = set()  # of those, who has triggered
        self._news: deque[str] = deque()
        self.changes = 0
        """How often the followed aircraft has changed: links compare it to let in what they have left out."""
        self.count(self._settings.aircraft)

    @property
    def followed(self) -> int | None:
        """System id of the followed aircraft; None until one triggers."""
        return self._followed

    @property
    def why(self) -> str:
        """Why that one is followed."""
        return "as asked" if self._asked else "the first to trigger a camera"

    def count(self, aircraft: AircraftIds) -> None:
        """Of several aircraft the triggers of all these count, and none is followed. To be called before any is heard."""
        self._named = aircraft
        if aircraft:
            self._followed = None
            self._counted = set() if aircraft == "all" else set(aircraft)

    @property
    def counted(self) -> tuple[int, ...]:
        """The aircraft whose triggers count, where several fly; of `all`, those that have triggered."""
        with self._lock:
            return tuple(sorted(self._counted))

    @property
    def is_of_several(self) -> bool:
        """Whether the triggers of several count, even if none has come yet."""
        return bool(self._named)

    def counts(self, system: int) -> bool:
        """Whether the triggers of `system` count, as that of the followed one or of one of several."""
        return system in self._counted if self._named else system == self._followed

    def heard(self, system: int, now: float, *, autopilot: bool = False) -> None:
        """A message of `system` came; `autopilot`: a HEARTBEAT of one."""
        with self._lock:
            self._heard[system] = max(now, self._heard.get(system, now))
            self._latest = max(self._latest, now)
            if autopilot:
                self._autopilots.add(system)

    def triggered(self, system: int, now: float) -> bool:
        """`system` triggered a camera; whether it is followed, or one of several that count."""
        with self._lock:
            if self._named:
                return self._counts_now(system)
            self._first_trigger.setdefault(system, now)
            self._last_trigger[system] = now
            self._look(now)
            return self._followed == system

    def look(self, now: float, *, at_once: bool = False) -> None:
        """Decide what can be decided at `now`; `at_once`: nothing more will be heard."""
        with self._lock:
            if not self._named:
                self._look(float("inf") if at_once else now)

    def choose(self, system: int) -> bool:
        """The operator's choice; False if nothing was heard of `system`."""
        with self._lock:
            if self._named or system not in self._heard:
                return False
            self._asked = True
            if system != self._followed:
                self._follow(system, f"system {system} is followed from now on, as asked")
            return True

    def systems(self) -> list[int]:
        """System ids heard so far."""
        with self._lock:
            return sorted(self._heard)

    def news(self) -> Iterator[str]:
        """What the operator is to be told, once."""
        while self._news:
            try:
                yield self._news.popleft()
            except IndexError:  # another link was faster
                return

    def _counts_now(self, system: int) -> bool:
        """Of `all`, as many as there are places for; one whose autopilot is heard takes that of one of which none is."""
        if self._named == "all" and system not in self._counted:
            if len(self._counted) >= MOST_AIRCRAFT and system in self._autopilots:
                self._counted -= set(sorted(self._counted - self._autopilots)[:1])
            if len(self._counted) < MOST_AIRCRAFT:
                self._counted.add(system)
        return system in self._counted

    def _look(self, now: float) -> None:
        if self._followed is None:
            self._decide(now)
        elif not self._asked and (follower := self._successor(self._followed)) is not None:
            silence = self._latest - self._heard.get(self._followed, 0.0)
            text = (
                f"system {self._followed} has been silent for {silence:.0f} s and system {follower} triggers a camera"
            )
            self._follow(follower, f"{text}: system {follower} is followed now")

    def _decide(self, now: float) -> None:
        """An aircraft is known by the HEARTBEAT of its autopilot; without one in time, the first to trigger is followed."""
        order = sorted(self._first_trigger, key=self._first_trigger.__getitem__)
        known = [system for system in order if system in self._autopilots]
        if known:
            others = [str(system) for system in sorted(self._autopilots - {known[0]})]
            told = ", ".join(others[:MOST_TOLD]) + (f" and {len(others) - MOST_TOLD} more" * (len(others) > MOST_TOLD))
            choose = f"; heard too: {told} (gcs-mosaic vehicle ID follows another)" if others else ""
            self._follow(known[0], f"system {known[0]} is followed, the first to trigger a camera{choose}")
        elif order and now - self._first_trigger[order[0]] >= self._settings.decide_after_s:
            text = f"system {order[0]} is followed, the first to trigger a camera, though no autopilot of it is heard"
            self._follow(order[0], text)

    def _successor(self, followed: int) -> int | None:
        """The aircraft that has triggered last, if the followed one has been silent for so long before that.

        One of which no autopilot was heard gives way sooner, but not to another such.
        """
        is_known = followed in self._autopilots
        patience = self._settings.release_s if is_known else self._settings.decide_after_s
        silent_since = self._heard.get(followed, 0.0)
        if self._latest - silent_since <= (patience if self._autopilots else self._settings.release_s):
            return None
        others = [
            system
            for system, last in self._last_trigger.items()
            if system != followed and last > silent_since and (system in self._autopilots or not self._autopilots)
        ]
        return max(others, key=self._last_trigger.__getitem__, default=None)

    def _follow(self, system: int, text: str) -> None:
        self._followed = system
        self.changes += 1
        self._news.append(text)


class LeftOut:
    """The newest triggers of each aircraft that is not followed, and how many there were: the operator may choose it yet.

    The system silent longest is forgotten.
    """

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
