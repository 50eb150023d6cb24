"""Candidate search for matching events with frames: by name, by counters, by times."""

from __future__ import annotations

from collections.abc import Collection, Hashable
from itertools import takewhile

from gcs_mosaic.messages import Teller
from gcs_mosaic.triggers.credibility import Credibility
from gcs_mosaic.triggers.delay import UsualDelay
from gcs_mosaic.triggers.index import Index, PendingEvent, PendingFrame, State
from gcs_mosaic.triggers.names import stem_of
from gcs_mosaic.triggers.outcomes import How
from gcs_mosaic.triggers.sequence_offsets import Learnt
from gcs_mosaic.triggers.settings import PairingSettings

NAMED_EARLY_S = (
    10.0  # a message that names a file may come so much later than the file: it is asked for again when it is lost
)
_CLEARLY = 0.6  # as a share of half the time between two shots


def lag(event: PendingEvent, frame: PendingFrame) -> float:
    """Seconds from the shot to the arrival of the file."""
    return frame.frame.received - event.moment


def _came_before(event: PendingEvent, frame: PendingFrame) -> bool:
    """Whether the file was there before the picture can have been taken; what was there at the start has no such time."""
    return frame.fresh and lag(event, frame) < -NAMED_EARLY_S


def keys_of(name: str) -> list[Hashable]:
    """What a file is looked up by, the surest first: its name, that without case, and its stem whatever the extension."""
    return [name, ("folded", name.casefold()), ("stem", stem_of(name))]


def _may_take(event: PendingEvent, frame: PendingFrame) -> bool:
    """Whether no name has settled the event, or only that of a companion while it names this frame itself."""
    names = {hint.casefold() for _, hint in event.hints}
    if event.frame is not None and _is_called(event.frame, names):
        return _is_of_folder(event, frame) and not _is_of_folder(event, event.frame)
    return event.how is not How.NAME or _is_called(frame, names)


def _is_of_folder(event: PendingEvent, frame: PendingFrame) -> bool:
    """Whether the event names the frame's file with its folder: cameras call files of two folders alike."""
    path = frame.frame.path
    return (path.parent.name.casefold(), path.name.casefold()) in event.folders


def _is_called(frame: PendingFrame, folded: Collection[str]) -> bool:
    """Whether one of its files has one of these names, given without case."""
    return any(name.casefold() in folded for name in frame.called)


class FrameSearch:
    """Searches both indexes with the learnt offsets and delay; read-only."""

    def __init__(self, events: Index[PendingEvent], frames: Index[PendingFrame], settings: PairingSettings) -> None:
        self._events, self._frames, self._settings = events, frames, settings
        self.learnt = Learnt()
        self.sources = Credibility(settings)

    @property
    def delay(self) -> UsualDelay:
        """The usual delay, by the most credible source."""
        return self.sources.delay

    def rank(self, event: PendingEvent) -> int:
        """That of the most credible of those who told the event: 0 doubtful, 1 unknown, 2 proved true."""
        return max(map(self.sources.rank, event.tellers), default=1)

    def is_doubtful(self, event: PendingEvent) -> bool:
        """Whether all are who told it."""
        return self.rank(event) == 0

    def named(self, event: PendingEvent) -> PendingFrame | None:
        """The frame that the event names, unless already matched by name, or with an event that is more credible."""
        if event.how is How.NAME:
            return None
        believed = [hint for teller, hint in event.hints if self._is_believed(event, teller)]
        keys = [key for keys in zip(*map(keys_of, believed), strict=True) for key in keys]
        frames = {frame: None for key in keys for frame in self._frames.under(key) if self._may_be_named(event, frame)}
        return max(frames, key=lambda frame: _is_of_folder(event, frame), default=None)  # the first of equals

    def naming(self, frame: PendingFrame) -> PendingEvent | None:
        """The event that names the frame, unless already matched by name as well; the more credible comes first."""
        keys = [key for name in frame.called for key in keys_of(name)]
        events = {event: None for key in keys for event in self._events.under(key)}
        meant = [
            event
            for event in events
            if event.state is not State.FAILED
            if _may_take(event, frame) and not _came_before(event, frame)
            if any(keys_of(hint)[-1] in keys and self._is_believed(event, teller) for teller, hint in event.hints)
        ]
        return max(meant, key=lambda event: (self.rank(event), _is_of_folder(event, frame)), default=None)

    def names(self, event: PendingEvent, frame: PendingFrame) -> bool:
        """Whether a believed message about the event gives just this name."""
        names = {name.casefold() for name in frame.called}
        return any(hint.casefold() in names and self._is_believed(event, teller) for teller, hint in event.hints)

    def may_fail(self, event: PendingEvent, teller: Teller) -> bool:
        """Whether `teller` may say that the shot brought no picture: who told it first, or nobody more credible disagrees."""
        return teller == event.tellers[0] or self._is_believed(event, teller)

    def _is_believed(self, event: PendingEvent, teller: Teller) -> bool:
        """Whether nobody who told the event is more credible."""
        return 0 < self.sources.rank(teller) >= self.rank(event)

    def _may_be_named(self, event: PendingEvent, frame: PendingFrame) -> bool:
        if _came_before(event, frame):
            return False
        if frame.event is None:
            return True
        is_surer = frame.event.how is not How.NAME or (
            _is_of_folder(event, frame) and not _is_of_folder(frame.event, frame)
        )
        return is_surer and self.rank(event) >= self.rank(frame.event)

    def numbered(self, event: PendingEvent) -> PendingFrame | None:
        """The orphan whose file number agrees with one of the event's counters."""
        counts = dict(event.counts)
        for (stream, place), offset in self.learnt.offsets():
            for frame in self._frames.under((place, counts[stream] + offset)) if stream in counts else ():
                if self._may_belong(event, frame) and lag(event, frame) >= -self._settings.early_s:
                    return frame
        return None

    def counting(self, frame: PendingFrame) -> PendingEvent | None:
        events = [
            event
            for (stream, place), offset in self.learnt.offsets()
            if place in frame.numbers
            for event in self._events.under((stream, frame.numbers[place] - offset))
            if self._may_belong(event, frame) and lag(event, frame) >= -self._settings.early_s
        ]
        return min(events, key=self.is_doubtful, default=None)  # the first of equals

    def frame_by_time(self, event: PendingEvent) -> PendingFrame | None:
        """The orphan with the delay closest to the usual one, or the nearest in time while that is unknown."""
        recent = takewhile(lambda frame: lag(event, frame) >= -self._settings.early_s, self._frames.newest_first())
        frames = [frame for frame in recent if self._is_near(event, frame)]
        usual = self.delay.value or 0.0
        return min(frames, key=lambda frame: abs(lag(event, frame) - usual), default=None)

    def event_by_time(self, frame: PendingFrame) -> PendingEvent | None:
        """The open event with the delay closest to the usual one, or the oldest while that is unknown; doubtful ones last."""
        events = [event for event in self._events.oldest_first() if self._is_near(event, frame)]
        usual = self.delay.value
        if usual is None:
            return events[0] if events else None
        return min(events, key=lambda event: (self.is_doubtful(event), abs(lag(event, frame) - usual)), default=None)

    def better_than_doubtful(self, frame: PendingFrame) -> PendingEvent | None:
        """The credible open event to which a frame belongs that a doubtful one has."""
        held = frame.event
        if held is None or held.how is How.ASKED or not self.is_doubtful(held):
            return None
        frame.event = None  # as if it were free
        found = self.event_by_time(frame)
        frame.event = held
        return None if found is None or self.is_doubtful(found) else found

    def clearly_nearest(self, frame: PendingFrame) -> PendingEvent | None:
        """The event, matched or not, with the usual delay, if it is much nearer than any other can be."""
        if self.delay.value is None or not frame.fresh:
            return None
        usual = self.delay.value
        events = (event for event in self._events.oldest_first() if not self.is_doubtful(event))
        nearest = min(events, key=lambda event: abs(lag(event, frame) - usual), default=None)
        clear = nearest and abs(lag(nearest, frame) - usual) < _CLEARLY * self.delay.tolerance_s
        return nearest if clear else None

    def _is_near(self, event: PendingEvent, frame: PendingFrame) -> bool:
        after = lag(event, frame)
        if not -self._settings.early_s <= after <= self._settings.window_s:
            return False  # nearly all, of which nothing else need be looked at
        usual = self.delay.value
        as_usual = usual is None or abs(after - usual) <= self.delay.tolerance_s
        return as_usual and self._may_belong(event, frame) and not self.learnt.contradicts(event, frame)

    def _may_belong(self, event: PendingEvent, frame: PendingFrame) -> bool:
        """Both are free, and the event does not name another file in a flight where names are reliable."""
        named_otherwise = self.learnt.names_work and event.hints
        return event.open and frame.fresh and not frame.event and not named_otherwise
