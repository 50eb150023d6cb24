"""What earlier matches teach about later ones: how long frames take, and how file numbers and event counters differ."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from statistics import median

from gcs_mosaic.link.counters import OffsetVotes, StreamKey
from gcs_mosaic.pairing.outcomes import How
from gcs_mosaic.pairing.shelves import HeldEvent, HeldFrame

_LAGS = 9  # matches that tell the usual lag: a few late ones do not move their median
_ENOUGH_LAGS = 3


def lag(event: HeldEvent, frame: HeldFrame) -> float:
    """Seconds from the shot to the finding of the file."""
    return frame.frame.received - event.moment


class Learnt:
    """Grows with every match."""

    def __init__(self, window_s: float) -> None:
        self.names_work = False  # whether a file name in an event has ever named a frame
        self.usual_lag: float | None = None  # seconds from shot to file; None until a few matches tell it
        self._window_s = window_s
        self._lags: deque[float] = deque(maxlen=_LAGS)
        self._offsets: dict[StreamKey, OffsetVotes] = {}

    def offset(self, stream: StreamKey) -> int | None:
        """File number minus event counter, None while unknown."""
        votes = self._offsets.get(stream)
        return votes.offset if votes else None

    def offsets(self) -> Iterator[tuple[StreamKey, int]]:
        """All that are known."""
        return ((stream, votes.offset) for stream, votes in self._offsets.items() if votes.offset is not None)

    def matched(self, event: HeldEvent, frame: HeldFrame, how: How) -> None:
        """A match was made by `how`."""
        self.names_work |= how is How.NAME
        if how is not How.SEQUENCE:
            self.vote(event, frame, certain=how is How.NAME)
        if abs(lag(event, frame)) <= self._window_s:
            self._lags.append(lag(event, frame))
            self.usual_lag = median(self._lags) if len(self._lags) >= _ENOUGH_LAGS else None

    def vote(self, event: HeldEvent, frame: HeldFrame, *, certain: bool = False) -> None:
        """The two seem to belong together, whatever they were matched with."""
        if frame.number is None:
            return
        for stream, count in event.counts:
            votes = self._offsets.setdefault(stream, OffsetVotes())
            (votes.settle if certain else votes.vote)(frame.number - count)

    def contradicts(self, event: HeldEvent, frame: HeldFrame) -> bool:
        """Whether the file's number goes with another count than the event's."""
        known = [(self.offset(stream), count) for stream, count in event.counts]
        expected = [offset + count for offset, count in known if offset is not None]
        return frame.number is not None and bool(expected) and frame.number not in expected
