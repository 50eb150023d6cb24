"""Events and frames that may still be matched, indexed by name, number and counter."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Hashable, Iterable, Iterator
from dataclasses import dataclass, field
from enum import Enum
from typing import Generic, TypeAlias, TypeVar

from gcs_mosaic.messages import Frame, Teller, TriggerEvent
from gcs_mosaic.triggers.counters import StreamKey
from gcs_mosaic.triggers.names import Field
from gcs_mosaic.triggers.outcomes import How

Count: TypeAlias = tuple[StreamKey, int]


class State(Enum):
    PENDING = "pending"
    MATCHED = "matched"
    MISSING = "missing"
    FAILED = "failed"


@dataclass(slots=True, eq=False)
class PendingEvent:
    """An event; `counts`, `hints` (base names of files) and `folders` (theirs and these, without case) are of all that
    told it, `moment` is its time on the host's monotonic clock."""

    id: int
    event: TriggerEvent
    moment: float
    since: float
    state: State = State.PENDING
    frame: PendingFrame | None = None
    how: How | None = None
    counts: list[Count] = field(default_factory=list)
    hints: list[tuple[Teller, str]] = field(default_factory=list)
    folders: set[tuple[str, str]] = field(default_factory=set)
    tellers: list[Teller] = field(default_factory=list)

    @property
    def open(self) -> bool:
        return self.state in (State.PENDING, State.MISSING)


@dataclass(slots=True, eq=False)
class PendingFrame:
    """A frame, the numbers in its name, and the base names of the files that brought the same picture again."""

    frame: Frame
    numbers: dict[Field, int]
    fresh: bool
    event: PendingEvent | None = None
    copies: list[str] = field(default_factory=list)

    @property
    def called(self) -> list[str]:
        """The base names of all its files."""
        return [self.frame.path.name, *self.copies]


Held = TypeVar("Held", PendingEvent, PendingFrame)


class Index(Generic[Held]):
    """Items in order of arrival, each under any number of keys. The oldest are evicted when it is full."""

    def __init__(self, room: int) -> None:
        self._room = room
        self._keys: OrderedDict[Held, list[Hashable]] = OrderedDict()
        self._under: dict[Hashable, list[Held]] = {}
        self.evicted = 0
        """How many are not held any more, because there was no room."""

    def put(self, held: Held, keys: Iterable[Hashable]) -> None:
        """Add `held`, or add keys to it."""
        known = self._keys.setdefault(held, [])
        for key in keys:
            if key not in known:
                known.append(key)
                self._under.setdefault(key, []).append(held)

    def __contains__(self, held: Held) -> bool:
        return held in self._keys

    def overflow(self) -> list[Held]:
        """Evict the oldest items beyond the capacity; returns them."""
        taken_off = []
        while len(self._keys) > self._room:
            taken_off.append(next(iter(self._keys)))
            self.remove(taken_off[-1])
        self.evicted += len(taken_off)
        return taken_off

    def remove(self, held: Held) -> None:
        """Take it out."""
        for key in self._keys.pop(held):
            self._under[key].remove(held)
            if not self._under[key]:
                del self._under[key]

    def under(self, key: Hashable) -> Iterator[Held]:
        """Items under `key`, newest first."""
        return reversed(self._under.get(key, []))

    def newest_first(self) -> Iterator[Held]:
        return reversed(self._keys)

    def oldest_first(self) -> Iterator[Held]:
        return iter(self._keys)
