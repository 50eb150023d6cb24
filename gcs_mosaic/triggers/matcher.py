"""Matches events with frames. An event is a hint, not a gate: no frame ever waits for one."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterator
from dataclasses import replace
from itertools import islice

from gcs_mosaic.messages import CaptureResult, Frame, Teller, TriggerEvent
from gcs_mosaic.triggers.candidates import FrameSearch, keys_of, lag
from gcs_mosaic.triggers.counters import StreamKey
from gcs_mosaic.triggers.doubts import Doubts
from gcs_mosaic.triggers.index import Index, PendingEvent, PendingFrame, State
from gcs_mosaic.triggers.names import folder_and_base, numbers_in
from gcs_mosaic.triggers.outcomes import EventCounts, Failed, How, Matched, Missing, Orphan, Outcome, Unmatched
from gcs_mosaic.triggers.settings import PairingSettings
from gcs_mosaic.triggers.stretch import LIVE, is_odd, judge, may_change

_TAKEN_BACK = 32  # frames looked through; a source is doubted long before
_LOOK_BACK_S = 5.0
_MOST_COPIES = 8  # of a frame whose names are known
_MISLED = 5  # most frames that can arrive before a counter is known to have shifted


class Pairing:
    """Matches by file name, by counters, by times, in that order of trust; `accounts` has the totals.

    Event ids are the caller's, frames are identified by name; both must be new. Every call returns its outcomes, in
    order.
    """

    def __init__(self, settings: PairingSettings | None = None) -> None:
        self._settings = settings or PairingSettings()
        self._events: Index[PendingEvent] = Index(self._settings.remembered)
        self._frames: Index[PendingFrame] = Index(self._settings.remembered)
        self._search = FrameSearch(self._events, self._frames, self._settings)
        self._votes: deque[tuple[PendingEvent, PendingFrame]] = deque(maxlen=_MISLED)
        self._states: Counter[State] = Counter()
        self._duplicates = self._frames_seen = 0
        self._look_back_at = 0.0
        self.doubts = Doubts()
        """Where another explanation is about as good."""

    def event(self, event_id: int, event: TriggerEvent, moment: float, now: float) -> list[Outcome]:
        """A new shot; `moment` is on the clock of `now` (`shots.Shots` provides both)."""
        if next(self._events.under(("id", event_id)), None):
            raise ValueError(f"event {event_id} was told before")
        held = PendingEvent(event_id, event, moment, now)
        if event.result is not CaptureResult.FAILED:
            self._search.sources.shot(event.teller, held.moment)
        self._states[State.PENDING] += 1
        self._events.put(held, [("id", event_id)])
        return [*self._look_at(held, event), *self._give_up_oldest()]

    def improve(self, event_id: int, event: TriggerEvent, now: float) -> list[Outcome]:
        """A more authoritative message about a known shot; the message itself counts as a duplicate."""
        self._duplicates += 1
        held = next(self._events.under(("id", event_id)), None)
        if held is None:
            return []
        if event.result is not CaptureResult.FAILED:
            self._search.sources.shot(event.teller, held.moment)
        return list(self._look_at(held, event))

    def duplicate(self, event_id: int | None = None, event: TriggerEvent | None = None) -> None:
        """A message without new information about the shot, but that its sender knows of it, too."""
        self._duplicates += 1
        held = next(self._events.under(("id", event_id)), None)
        if held is None or event is None or event.teller in held.tellers or event.result is CaptureResult.FAILED:
            return
        held.tellers.append(event.teller)
        self._search.sources.shot(event.teller, event.received)

    def frame(self, frame: Frame, now: float, *, fresh: bool = True, asked_by: int | None = None) -> list[Outcome]:
        """A new frame: matched, or an orphan for now. One that is not `fresh` was there at the start: its arrival says
        nothing about its capture, so only a name can match it. `asked_by`: the event that requested a stream's picture."""
        if next(self._frames.under(("frame", frame.name)), None):
            raise ValueError(f"frame {frame.name} came before")
        self._frames_seen += 1
        name = frame.path.name
        held = PendingFrame(frame, numbers_in(name), fresh)
        self._frames.put(held, [("frame", frame.name), *keys_of(name), *held.numbers.items()])
        self._frames.overflow()
        if fresh:
            self._search.sources.file(frame.received)
        outcomes = [*self._answer(held, asked_by), *self._check_counters(held), *self._take_back()]
        outcomes += () if held.event else self._find_event(held)
        outcomes += self._look_back(now)
        return outcomes if held.event else [*outcomes, Orphan(frame)]

    def whole_of(self, preview: str, frame: Frame) -> list[Outcome]:
        """The frame of the name `preview` was a smaller picture of this shot: all that is known of it is of `frame` now."""
        held = next(self._frames.under(("frame", preview)), None)
        if held is None:
            return []
        held.frame = replace(frame, received=held.frame.received)
        self._frames.put(held, [("frame", frame.name)])
        if held.event is None:
            return [Orphan(held.frame)]
        return [Matched(held.event.id, held.event.event, held.frame, held.event.how or How.TIME)]

    def also_called(self, name: str, file: str) -> list[Outcome] | None:
        """The picture of the frame `name` came once more, in a file of the base name `file`, as where a program copies or renames
        what it has received: an event that names that file is about this frame. None if that has an event that names it under
        another name."""
        held = next(self._frames.under(("frame", name)), None)
        if held is None or file in held.called or len(held.copies) >= _MOST_COPIES:
            return []
        if held.event is not None and held.event.how in (How.NAME, How.ASKED):
            return None
        held.copies.append(file)
        self._frames.put(held, keys_of(file))
        event = self._search.naming(held)
        return [] if event is None else list(self._match(event, held, How.NAME))

    def withdraw(self, name: str) -> list[Outcome]:
        """The frame of this name was none of its own: an event that was matched with it is looked at again."""
        held = next(self._frames.under(("frame", name)), None)
        if held is None:
            return []
        event, held.fresh = held.event, False
        self._frames.remove(held)
        self._frames_seen -= 1
        return [] if event is None else [*self._release(event), *self._find_another(event)]

    def known(self, event_id: int, name: str) -> list[Outcome]:
        """This event was matched with the frame of this name before, by what is not known any more; both have been told."""
        event = next(self._events.under(("id", event_id)), None)
        frame = next(self._frames.under(("frame", name)), None)
        if event is None or frame is None or event.frame is frame or event.state is State.FAILED:
            return []
        return list(self._match(event, frame, How.SEQUENCE))

    def credible(self) -> frozenset[Teller]:
        """The sources of events whose shots have proved true."""
        return self._search.sources.credible()

    def tick(self, now: float) -> list[Missing]:
        """Pending events that are overdue at `now` become missing."""
        due = [
            held
            for held in self._events.oldest_first()
            if held.state is State.PENDING and now - held.since >= self._settings.missing_after_s
        ]
        return [self._missing(held) for held in due]

    def close(self) -> list[Outcome]:
        """End of input: match the rest by sequence; events still pending become missing."""
        outcomes = [
            *self._take_back(),
            *self._judge(
                list(self._events.oldest_first()),
                list(self._frames.oldest_first()),
                is_part=self._events.evicted + self._frames.evicted > 0,
            ),
        ]
        pending = [held for held in self._events.oldest_first() if held.state is State.PENDING]
        return [*outcomes, *(self._missing(held) for held in pending)]

    def accounts(self) -> EventCounts:
        """The totals; every event and frame is counted exactly once."""
        states = {state.value: self._states[state] for state in State}
        orphans = self._frames_seen - self._states[State.MATCHED]
        return EventCounts(**states, duplicate=self._duplicates, orphans=orphans)

    def _look_at(self, held: PendingEvent, event: TriggerEvent) -> Iterator[Outcome]:
        """Process one source's message about a shot."""
        self._note(held, event)
        if held.state is State.FAILED:  # one source's failure is final, whatever another source reports
            return
        if event.result is CaptureResult.FAILED:
            if not self._search.may_fail(held, event.teller):
                return
            yield from self._release(held)
            self._move(held, State.FAILED)
            yield Failed(held.id, event)
            return
        yield from self._find_frame(held)

    def _note(self, held: PendingEvent, event: TriggerEvent) -> None:
        held.event = event
        held.tellers.append(event.teller)
        if event.sequence is not None:
            stream = StreamKey(event.vehicle, event.component, event.camera, event.source)
            held.counts.append((stream, event.sequence))
            if not self._search.is_doubtful(held):
                self._search.learnt.counted(stream, event.sequence, held.moment)
            self._events.put(held, [(stream, event.sequence)])
        if event.file_hint:
            folder, base = folder_and_base(event.file_hint)
            held.hints.append((event.teller, base))
            held.folders |= {(folder.casefold(), base.casefold())} if folder else set()
            self._events.put(held, keys_of(base))

    def _find_frame(self, held: PendingEvent, *, by_time: bool = True) -> Iterator[Outcome]:
        if frame := self._search.named(held):
            yield from self._match(held, frame, How.NAME)
        elif held.open:
            if frame := self._search.numbered(held):
                yield from self._match(held, frame, How.SEQUENCE)
            elif by_time and (frame := self._search.frame_by_time(held)):
                yield from self._match(held, frame, How.TIME)

    def _find_event(self, held: PendingFrame) -> Iterator[Outcome]:
        if event := self._search.naming(held):
            yield from self._match(event, held, How.NAME)
        elif event := self._search.counting(held):
            yield from self._match(event, held, How.SEQUENCE)
        elif event := self._search.event_by_time(held):
            yield from self._match(event, held, How.TIME)

    def _answer(self, held: PendingFrame, asked_by: int | None) -> Iterator[Outcome]:
        event = next(self._events.under(("id", asked_by)), None)
        if event is not None and event.state is not State.FAILED:
            yield from self._match(event, held, How.ASKED)

    def _check_counters(self, held: PendingFrame) -> Iterator[Outcome]:
        """Verify the counters' offsets by the times; if they have shifted, correct the matches made with the old ones."""
        nearest, before = self._search.clearly_nearest(held), dict(self._search.learnt.offsets())
        if nearest is None:
            return
        self._search.learnt.vote(nearest, held)
        self._votes.append((nearest, held))
        if dict(self._search.learnt.offsets()) == before:
            return
        misled = [(event, frame) for event, frame in self._votes if self._are_misled(event, frame)]
        for event, frame in misled:
            yield from self._release(event)
            if frame.event:
                yield from self._release(frame.event)
        for event, frame in misled:
            if event.open:
                yield from self._match(event, frame, How.SEQUENCE)
        for event in [event for event in self._events.oldest_first() if event.open]:
            # By times only recent ones can find one: looking through all frames for each event would take seconds.
            yield from self._find_frame(event, by_time=lag(event, held) <= self._settings.window_s)

    def _take_back(self) -> Iterator[Outcome]:
        """Give to credible events the frames that doubtful ones took before they were doubted."""
        for frame in list(islice(self._frames.newest_first(), _TAKEN_BACK)):
            if (event := self._search.better_than_doubtful(frame)) is not None:
                yield from self._match(event, frame, How.TIME)

    def _are_misled(self, event: PendingEvent, frame: PendingFrame) -> bool:
        """Whether times and counters now agree on this pair, but it is not matched."""
        apart = frame.event is not event and How.NAME not in (event.how, frame.event and frame.event.how)
        return apart and event.state is not State.FAILED and not self._search.learnt.contradicts(event, frame)

    def _match(self, event: PendingEvent, frame: PendingFrame, how: How) -> Iterator[Outcome]:
        robbed, freed = frame.event, event.frame
        if robbed:
            yield from self._release(robbed)
        yield from self._release(event)
        if how < How.NAME and self._search.names(event, frame):
            how = How.NAME  # found by other means before the names were looked at
        event.frame, event.how, frame.event = frame, how, event
        self._move(event, State.MATCHED)
        if how is How.NAME:
            self._search.learnt.named(event, frame)
        yield Matched(event.id, event.event, frame.frame, how)
        if robbed:
            yield from self._find_another(robbed)
        if freed and not freed.event:
            yield from self._find_event(freed)

    def _look_back(self, now: float) -> Iterator[Outcome]:
        """Correct what the newest stretch contradicts by now."""
        if now < self._look_back_at:
            return
        self._look_back_at = now + _LOOK_BACK_S
        shots = [
            held for held in islice(self._events.newest_first(), LIVE) if now - held.moment >= self._settings.window_s
        ]
        if is_odd(shots):
            # Files of newer shots are left out as these are: with some that have no shot any shift of the rows costs nothing.
            orphans = [held for held in islice(self._frames.newest_first(), LIVE) if held.event is None]
            yield from self._judge(shots[::-1], [*(held.frame for held in shots[::-1] if held.frame), *orphans[::-1]])
        else:
            self.doubts = Doubts()

    def _judge(
        self, events: list[PendingEvent], frames: list[PendingFrame], *, is_part: bool = False
    ) -> Iterator[Outcome]:
        """Decide by the whole stretch what names have not settled, and note what is ambiguous."""
        named = self._search.learnt.names_work
        shots = [held for held in events if may_change(held) and not (named and held.hints)]
        shots = [held for held in shots if held.frame or not self._search.is_doubtful(held)]
        found = judge(shots, [held for held in frames if may_change(held)], is_part=is_part)
        self.doubts = found.doubts
        for event in found.refuted:
            yield from self._release(event)
        for event, frame in found.pairs:
            yield from self._release(event)
            if frame.event:
                yield from self._release(frame.event)
        for event, frame in found.pairs:
            yield from self._match(event, frame, How.SEQUENCE)

    def _release(self, held: PendingEvent) -> Iterator[Outcome]:
        if held.frame:
            frame, held.frame, held.how = held.frame, None, None
            frame.event = None
            self._move(held, State.PENDING)
            yield Unmatched(held.id, frame.frame)

    def _find_another(self, held: PendingEvent) -> Iterator[Outcome]:
        """Another frame for an event that has lost its own; one that is no longer indexed would never become missing."""
        yield from self._find_frame(held)
        if held.state is State.PENDING and held not in self._events:
            yield self._missing(held)

    def _missing(self, held: PendingEvent) -> Missing:
        self._move(held, State.MISSING)
        return Missing(held.id, held.event)

    def _move(self, held: PendingEvent, state: State) -> None:
        self._states[held.state] -= 1
        self._states[state] += 1
        held.state = state

    def _give_up_oldest(self) -> list[Outcome]:
        given_up = self._events.overflow()
        for held in given_up:
            held.how = How.NAME  # a match that is no longer indexed cannot be undone
        return [self._missing(held) for held in given_up if held.state is State.PENDING]
