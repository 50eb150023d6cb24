"""Learns from earlier matches whether names are reliable, and the offset of file numbers from counters."""

from __future__ import annotations

from collections.abc import Iterator

from gcs_mosaic.triggers.counters import OffsetVotes, StreamKey
from gcs_mosaic.triggers.index import PendingEvent, PendingFrame


class Learnt:
    """Updated with every match."""

    def __init__(self) -> None:
        self.names_work = False  # whether a file name in an event has ever named a frame
        self._offsets: dict[StreamKey, OffsetVotes] = {}

    def offset(self, stream: StreamKey) -> int | None:
        """File number minus event counter, None while unknown."""
        votes = self._offsets.get(stream)
        return votes.offset if votes else None

    def offsets(self) -> Iterator[tuple[StreamKey, int]]:
        """All known offsets."""
        return ((stream, votes.offset) for stream, votes in self._offsets.items() if votes.offset is not None)

    def named(self, event: PendingEvent, frame: PendingFrame) -> None:
        """Learn from a match by name, which is certain."""
        self.names_work = True
        if frame.number is not None:
            for stream, count in event.counts:
                self._offsets.setdefault(stream, OffsetVotes()).settle(frame.number - count)

    def vote(self, event: PendingEvent, frame: PendingFrame) -> None:
        """Count a likely pair, whatever the two are matched with."""
        if frame.number is not None:
            for stream, count in event.counts:
                self._offsets.setdefault(stream, OffsetVotes()).vote(frame.number - count)

    def contradicts(self, event: PendingEvent, frame: PendingFrame) -> bool:
        """Whether the file number agrees with none of the event's counters whose offset is known."""
        known = [(self.offset(stream), count) for stream, count in event.counts]
        expected = [offset + count for offset, count in known if offset is not None]
        return frame.number is not None and bool(expected) and frame.number not in expected
