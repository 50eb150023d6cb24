"""Events and frames that may still find each other, ready to be looked up by what may connect them."""

from __future__ import annotations

import re
from collections import OrderedDict
from collections.abc import Hashable, Iterable, Iterator
from dataclasses import dataclass, field
from enum import Enum
from typing import Generic, TypeAlias, TypeVar

from gcs_mosaic.messages import Frame, TriggerEvent
from gcs_mosaic.triggers.counters import StreamKey
from gcs_mosaic.triggers.outcomes import How

Count: TypeAlias = tuple[StreamKey, int]


class State(Enum):
    PENDING = "pending"
    MATCHED = "matched"
    MISSING = "missing"
    FAILED = "failed"


@dataclass(slots=True, eq=False)
class PendingEvent:
    """An event; `counts` are those of all its witnesses, `moment` is when it happened (host's monotonic clock)."""

    id: int
    event: TriggerEvent
    moment: float
    since: float
    state: State = State.PENDING
    frame: PendingFrame | None = None
    how: How | None = None
    counts: list[Count] = field(default_factory=list)
    hints: list[str] = field(default_factory=list)

    @property
    def open(self) -> bool:
        return self.state in (State.PENDING, State.MISSING)


@dataclass(slots=True, eq=False)
class PendingFrame:
    """A frame and the number in its name, if there is one."""

    frame: Frame
    number: int | None
    fresh: bool
    event: PendingEvent | None = None


def number_in(name: str) -> int | None:
    """The last number in a file's name: what cameras count with."""
    numbers = re.findall(r"[0-9]+", name.rpartition(".")[0] or name)
    return int(numbers[-1]) if numbers and len(numbers[-1]) <= 12 else None


Held = TypeVar("Held", PendingEvent, PendingFrame)


class Index(Generic[Held]):
    """Things in the order in which they came, each under any number of keys. The oldest leave when it is full."""

    def __init__(self, room: int) -> None:
        self._room = room
        self._keys: OrderedDict[Held, list[Hashable]] = OrderedDict()
        self._under: dict[Hashable, list[Held]] = {}

    def put(self, held: Held, keys: Iterable[Hashable]) -> None:
        """Put `held` on the shelf, or under more keys."""
        known = self._keys.setdefault(held, [])
        for key in keys:
            if key not in known:
                known.append(key)
                self._under.setdefault(key, []).append(held)

    def overflow(self) -> list[Held]:
        """Take the oldest off until the shelf is no longer too full; returns them."""
        taken_off = []
        while len(self._keys) > self._room:
            held, keys = self._keys.popitem(last=False)
            for key in keys:
                self._under[key].remove(held)
                if not self._under[key]:
                    del self._under[key]
            taken_off.append(held)
        return taken_off

    def under(self, key: Hashable) -> Iterator[Held]:
        """What lies under `key`, the newest first."""
        return reversed(self._under.get(key, []))

    def newest_first(self) -> Iterator[Held]:
        return reversed(self._keys)

    def oldest_first(self) -> Iterator[Held]:
        return iter(self._keys)
