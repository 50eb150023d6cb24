"""What two counters of the same shots differ by, learnt from pairs that something else has put together. Pure."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

from gcs_mosaic.events import Source

TO_LEARN = 2  # one pair may be chance
TO_CHANGE = 3  # a late message or two must not move what has proven itself
_RECENT = 8  # messages of one stream that may lie near another's


@dataclass(slots=True)
class OffsetVotes:
    """`offset` is None until enough pairs in a row agree; later pairs that agree on another one replace it."""

    offset: int | None = None
    _candidate: int | None = None
    _in_a_row: int = 0

    def vote(self, offset: int) -> None:
        """One more pair differs by `offset`."""
        if offset == self.offset:
            self._candidate, self._in_a_row = None, 0
            return
        self._in_a_row = self._in_a_row + 1 if offset == self._candidate else 1
        self._candidate = offset
        if self._in_a_row >= (TO_LEARN if self.offset is None else TO_CHANGE):
            self.settle(offset)

    def settle(self, offset: int) -> None:
        """The offset is known for certain."""
        self.offset, self._candidate, self._in_a_row = offset, None, 0


class StreamKey(NamedTuple):
    """One counter: every source of every component counts for each of its cameras."""

    vehicle: int
    component: int
    camera: int
    source: Source


class Counters:
    """How the counters of several sources relate, learnt from messages that come close together."""

    def __init__(self, window_s: float) -> None:
        self._window_s = window_s
        self._recent: dict[StreamKey, deque[tuple[float, int]]] = {}
        self._votes: dict[tuple[StreamKey, StreamKey], OffsetVotes] = {}

    def heard(self, key: StreamKey, sequence: int, moment: float) -> None:
        """Stream `key` has counted `sequence` at `moment`. A counter that goes backwards begins anew."""
        recent = self._recent.setdefault(key, deque(maxlen=_RECENT))
        if recent and sequence <= recent[-1][1]:
            self._votes = {pair: votes for pair, votes in self._votes.items() if key not in pair}
        recent.append((moment, sequence))
        for other in self._recent:
            # The better witness is the later one, as a rule; asking the earlier one too would vote for the shot before.
            if other.vehicle == key.vehicle and other.source < key.source:
                self._vote(key, other)

    def expected(self, key: StreamKey, sequence: int) -> dict[StreamKey, int]:
        """What the other streams have counted, or will, when `key` counts `sequence`; those that are known."""
        known = {other: votes.offset for (own, other), votes in self._votes.items() if own == key}
        return {other: sequence + offset for other, offset in known.items() if offset is not None}

    def forget(self, key: StreamKey) -> None:
        """The stream is no longer of interest."""
        self._recent.pop(key, None)
        self._votes = {pair: votes for pair, votes in self._votes.items() if key not in pair}

    def _vote(self, key: StreamKey, other: StreamKey) -> None:
        moment, sequence = self._recent[key][-1]
        apart, count = min((abs(theirs - moment), count) for theirs, count in self._recent[other])
        if apart <= self._window_s:
            self._votes.setdefault((key, other), OffsetVotes()).vote(count - sequence)
            self._votes.setdefault((other, key), OffsetVotes()).vote(sequence - count)
