"""Learns from earlier matches whether names are reliable, and the offset of file numbers from counters."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TypeAlias

from gcs_mosaic.triggers.counters import OffsetVotes, StreamKey
from gcs_mosaic.triggers.index import PendingEvent, PendingFrame
from gcs_mosaic.triggers.names import Field

Ruler: TypeAlias = tuple[StreamKey, Field]
"""A counter, and one of the numbers in names of one kind, which may go with it."""
_MOST_RULERS = 256  # the oldest are forgotten: names are anybody's
ANEW = 0.5  # of the number before: a counter that falls below has begun anew, one of two shots in a wrong order has not


@dataclass(slots=True)
class _Votes:
    """Of one ruler. A number in names that stays the same (a width, a date) tells nothing, nor does such a counter."""

    votes: OffsetVotes = field(default_factory=OffsetVotes)
    last: tuple[int, int] | None = None

    def vary(self, number: int, count: int) -> bool:
        before, self.last = self.last, (number, count)
        return before is None or (number != before[0] and count != before[1])


class Learnt:
    """Updated with every match."""

    def __init__(self) -> None:
        self.names_work = False  # whether a file name in an event has ever named a frame
        self._rulers: OrderedDict[Ruler, _Votes] = OrderedDict()
        self._last: OrderedDict[StreamKey, tuple[float, int]] = OrderedDict()  # moment and number of its latest shot

    def counted(self, stream: StreamKey, count: int, moment: float) -> None:
        """A shot of `moment` has this number. What was learnt of a counter that has begun anew (a change of batteries, its end)
        holds no longer: by it files would be of the shots beside their own. What is told late is of an earlier moment."""
        before, last = self._last.get(stream, (moment, count))
        if moment < before:
            return
        if count < last * ANEW:
            for ruler in [ruler for ruler in self._rulers if ruler[0] == stream]:
                del self._rulers[ruler]
        self._last[stream] = moment, count
        self._last.move_to_end(stream)
        if len(self._last) > _MOST_RULERS:
            self._last.popitem(last=False)

    def offset(self, stream: StreamKey) -> int | None:
        """File number minus event counter, None while unknown."""
        return next((offset for (one, _), offset in self.offsets() if one == stream), None)

    def offsets(self) -> Iterator[tuple[Ruler, int]]:
        """All known offsets."""
        known = ((ruler, held.votes.offset) for ruler, held in self._rulers.items())
        return ((ruler, offset) for ruler, offset in known if offset is not None)

    def named(self, event: PendingEvent, frame: PendingFrame) -> None:
        """Learn from a match by name, which is certain."""
        self.names_work = True
        for ruler, number, count in _readings(event, frame):
            held = self._held(ruler)
            before = held.last
            if held.vary(number, count):
                (held.votes.settle if before else held.votes.vote)(number - count)

    def vote(self, event: PendingEvent, frame: PendingFrame) -> None:
        """Count a likely pair, whatever the two are matched with."""
        for ruler, number, count in _readings(event, frame):
            held = self._held(ruler)
            if held.vary(number, count):
                held.votes.vote(number - count)

    def contradicts(self, event: PendingEvent, frame: PendingFrame) -> bool:
        """Whether the numbers in the name agree with none of the event's counters whose offset is known."""
        known = [
            held.votes.offset == number - count
            for ruler, number, count in _readings(event, frame)
            if (held := self._rulers.get(ruler)) is not None and held.votes.offset is not None
        ]
        return bool(known) and not any(known)

    def _held(self, ruler: Ruler) -> _Votes:
        held = self._rulers.setdefault(ruler, _Votes())
        self._rulers.move_to_end(ruler)
        if len(self._rulers) > _MOST_RULERS:
            self._rulers.popitem(last=False)
        return held


def _readings(event: PendingEvent, frame: PendingFrame) -> Iterator[tuple[Ruler, int, int]]:
    for stream, count in event.counts:
        for place, number in frame.numbers.items():
            yield (stream, place), number, count
