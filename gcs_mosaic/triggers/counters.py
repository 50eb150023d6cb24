"""Learns the offset between two counters of the same shots from pairs matched by other means. Pure."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import NamedTuple

from gcs_mosaic.messages import Source

_VOTES = 5  # pairs that decide; a late message or two must not change an established offset
_MAJORITY = 4
_RECENT = 8  # messages kept per stream, to find the nearest to another's


@dataclass(slots=True)
class OffsetVotes:
    """`offset` is the difference in nearly all of the last pairs; None until known, and once none of them supports it."""

    offset: int | None = None
    _votes: deque[int] = field(default_factory=lambda: deque(maxlen=_VOTES))

    def vote(self, offset: int) -> None:
        """One more pair differs by `offset`."""
        self._votes.append(offset)
        if self._votes.count(offset) >= _MAJORITY:
            self.offset = offset
        elif self.offset not in self._votes:
            self.offset = None

    def settle(self, offset: int) -> None:
        """Set an offset known for certain."""
        self._votes.extend([offset] * _MAJORITY)
        self.offset = offset


class StreamKey(NamedTuple):
    """Identifies one counter: each source of each component counts separately for each of its cameras."""

    vehicle: int
    component: int
    camera: int
    source: Source


class Counters:
    """Offsets between the counters of several sources, learnt from messages close in time."""

    def __init__(self, window_s: float) -> None:
        self._window_s = window_s
        self._recent: dict[StreamKey, deque[tuple[float, int]]] = {}
        self._votes: dict[tuple[StreamKey, StreamKey], OffsetVotes] = {}

    def heard(self, key: StreamKey, sequence: int, moment: float) -> None:
        """Stream `key` counted `sequence` at `moment`. A counter that goes backwards has been reset."""
        recent = self._recent.setdefault(key, deque(maxlen=_RECENT))
        if recent and sequence <= recent[-1][1]:
            self._votes = {pair: votes for pair, votes in self._votes.items() if key not in pair}
        recent.append((moment, sequence))
        for other in self._recent:
            # The more authoritative source usually reports later; voting from the other one too would match the previous shot.
            if other.vehicle == key.vehicle and other.source < key.source:
                self._vote(key, other)

    def expected(self, key: StreamKey, sequence: int) -> dict[StreamKey, int]:
        """The other streams' sequence numbers of the shot that `key` counts as `sequence`, where the offset is known."""
        known = {other: votes.offset for (own, other), votes in self._votes.items() if own == key}
        return {other: sequence + offset for other, offset in known.items() if offset is not None}

    def forget(self, key: StreamKey) -> None:
        """Drop a stream."""
        self._recent.pop(key, None)
        self._votes = {pair: votes for pair, votes in self._votes.items() if key not in pair}

    def _vote(self, key: StreamKey, other: StreamKey) -> None:
        moment, sequence = self._recent[key][-1]
        apart, count = min((abs(theirs - moment), count) for theirs, count in self._recent[other])
        if apart <= self._window_s:
            self._votes.setdefault((key, other), OffsetVotes()).vote(count - sequence)
            self._votes.setdefault((other, key), OffsetVotes()).vote(sequence - count)
