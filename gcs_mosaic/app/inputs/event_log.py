"""Outcome of every camera event: messages about one shot are merged, shots are matched with frames, the ledger records all."""

from __future__ import annotations

import logging
from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

from gcs_mosaic.frames.pending_file import file_and_version
from gcs_mosaic.frames.video.names import video_and_ms
from gcs_mosaic.mavlink.flood import Trust
from gcs_mosaic.messages import Frame, Teller, TriggerEvent
from gcs_mosaic.store.flight_store import SET_ASIDE, frame_of
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.records import EventRecord, EventState, FrameRecord, FrameState
from gcs_mosaic.store.retry import Retry, at_once
from gcs_mosaic.triggers import Failed, Matched, Missing, Outcome, Pairing, PairingSettings, Unmatched
from gcs_mosaic.triggers.doubts import NONE, Doubts
from gcs_mosaic.triggers.shots import MOST_SHOTS, Better, CameraMessage, Duplicate, New, Shots

logger = logging.getLogger(__name__)

TIMED = 64  # newest frames of a resumed flight whose times tell the usual delay again: more than it is estimated from

K = TypeVar("K")


class EventLog:
    """Matches events with frames; `save` writes their outcomes into the ledger. `retry` runs every write. The sources of events
    whose shots prove true are told to `trust`.

    `apart`: each aircraft has a source of frames of its own, so its events are matched with its own frames alone, and nothing
    that is learnt of one (names, counters, delays, who is credible) is applied to another.
    """

    def __init__(
        self,
        ledger: Ledger,
        pairing: PairingSettings,
        retry: Retry = at_once,
        trust: Trust | None = None,
        *,
        apart: bool = False,
    ) -> None:
        self._ledger = ledger
        self._retry, self._trust = retry, trust or Trust()
        self._settings, self._apart = pairing, apart
        self._pairings: dict[int | None, Pairing] = {}  # by aircraft
        self._duplicates: list[tuple[int, int]] = []
        self._outcomes: list[Outcome] = []
        self._ids: OrderedDict[TriggerEvent, int] = OrderedDict()  # id of the shot each event reported
        self._shots: OrderedDict[int, int] = OrderedDict()  # id of a shot, by the number of the first message about it
        self._remembered = pairing.remembered

    def resume(self, told: Sequence[EventRecord | FrameRecord], shots: Shots, started_utc: float, out: Path) -> None:
        """Restore the state by replaying the resumed flight's events and frames in order.

        Matches are kept: requests to a stream, and matches by counting at the end, are recorded in the ledger only. Only the
        newest frames are matched by their times again.
        """
        matched: list[tuple[int, str, int]] = []
        stale = max(sum(isinstance(record, FrameRecord) for record in told) - TIMED, 0)
        now, first = 0.0, dict[str, str]()  # the frame of each content
        for record in told:
            if isinstance(record, EventRecord) and record.frame is not None:
                matched.append((record.id, record.frame, record.event.vehicle))
            if isinstance(record, EventRecord):
                now = record.event.received
                self._heard(shots.hear(record.event), record.id, now)
            elif record.state is FrameState.DUPLICATE and not record.had_event:
                stale -= 1
                copy = frame_of(record, out)
                now = copy.received
                self.copy(copy, now, first.get(record.content_hash or ""))
            else:
                frame, stale = frame_of(record, out), stale - 1
                first.setdefault(frame.content_hash, frame.name)
                now, fresh = frame.received, frame.modified >= started_utc and record.state not in SET_ASIDE
                self.frame(frame, now, fresh=fresh and stale < 0)
        self.tick(now)
        for event_id, name, vehicle in matched:
            self._outcomes += self._pairing_of(vehicle).known(event_id, name)

    def message(self, message: CameraMessage, now: float) -> None:
        """Add a camera message."""
        event = message.event
        self._heard(message, self._retry(lambda: self._ledger.record_event(event)), now)

    def _heard(self, message: CameraMessage, event_id: int, now: float) -> None:
        event, pairing = message.event, self._pairing_of(message.event.vehicle)
        match message.verdict:
            case New(moment):
                _remember(self._shots, message.number, event_id, MOST_SHOTS)
                _remember(self._ids, event, event_id, self._remembered)
                self._outcomes += pairing.event(event_id, event, moment, now)
            case Duplicate(of):
                shot = self._shots.get(of, event_id)
                pairing.duplicate(shot, event)
                self._note_duplicate(event, event_id, shot)
            case Better(of):
                shot = self._shots.get(of, event_id)
                self._note_duplicate(event, event_id, shot)
                self._outcomes += pairing.improve(shot, event, now)

    def frame(self, frame: Frame, now: float, *, fresh: bool) -> None:
        """Add a frame that is in the ledger; `fresh` if it arrived after the watch began. No event is about one of a video."""
        if video_and_ms(frame.name) is not None:
            return
        # Events name the original file, wherever its frame is kept and however often it was rewritten. Thousands of frames are
        # remembered here, without their files.
        frame = replace(frame, path=Path(file_and_version(frame.name)[0]), data=None)
        pairing = self._pairing_of(frame.vehicle)
        if frame.is_whole_of_earlier and frame.earlier is not None:
            self._outcomes += pairing.whole_of(frame.earlier, frame)
            return
        asked_by = self._ids.get(frame.taken_for) if frame.taken_for else None
        self._outcomes += pairing.frame(frame, now, fresh=fresh, asked_by=asked_by)
        self._trust.sources = self._credible()

    def copy(self, frame: Frame, now: float, of: str | None) -> None:
        """This one is none of its own, but the picture of the frame `of` in another file: an event may name either, and where one
        names the frame, another may still be about this file. None: which frame that is is not known."""
        if of is None:
            return
        file = Path(file_and_version(frame.name)[0]).name
        outcomes = self._pairing_of(frame.vehicle).also_called(of, file)
        if outcomes is None:
            self.frame(frame, now, fresh=False)  # its time says nothing of when the picture was taken
        else:
            self._outcomes += outcomes

    def withdraw(self, frame: Frame) -> None:
        """This one, told before, was no frame of its own: another one's file was written again."""
        self._outcomes += self._pairing_of(frame.vehicle).withdraw(frame.name)

    def _credible(self) -> frozenset[Teller]:
        """The sources of events whose shots have proved true."""
        return frozenset().union(*(pairing.credible() for pairing in self._pairings.values()))

    @property
    def doubts(self) -> Doubts:
        """Where another explanation of who belongs to whom is about as good, of the aircraft of which most is in doubt."""
        return max((pairing.doubts for pairing in self._pairings.values()), key=lambda one: one.pairs, default=NONE)

    def tick(self, now: float) -> list[Missing]:
        """Advance time; returns the events whose frames are now missing."""
        missing = [one for pairing in self._pairings.values() for one in pairing.tick(now)]
        for event in missing:
            logger.info("no frame has come for %s", event.event)
        self._outcomes += missing
        return missing

    def close(self) -> None:
        """No more messages or frames will arrive."""
        for pairing in self._pairings.values():
            self._outcomes += pairing.close()

    def _pairing_of(self, vehicle: int | None) -> Pairing:
        whose = vehicle if self._apart else None
        if whose not in self._pairings:
            self._pairings[whose] = Pairing(self._settings)
        return self._pairings[whose]

    def save(self) -> None:
        """Write all changes."""
        if self._outcomes or self._duplicates:
            self._retry(self._write_all)
            self._duplicates.clear()
            self._outcomes.clear()

    def _write_all(self) -> None:
        with self._ledger.transaction():
            for event_id, of in self._duplicates:
                self._ledger.settle_event(event_id, EventState.DUPLICATE, duplicate_of=of)
            for outcome in self._outcomes:
                self._write(outcome)

    def _note_duplicate(self, event: TriggerEvent, event_id: int, shot: int) -> None:
        _remember(self._ids, event, shot, self._remembered)
        self._duplicates.append((event_id, shot))

    def _write(self, outcome: Outcome) -> None:
        match outcome:
            case Matched():
                self._ledger.settle_event(outcome.event_id, EventState.MATCHED, frame=outcome.frame.name)
            case Unmatched():
                self._ledger.settle_event(outcome.event_id, EventState.PENDING)
            case Missing():
                self._ledger.settle_event(outcome.event_id, EventState.MISSING)
            case Failed():
                self._ledger.settle_event(outcome.event_id, EventState.FAILED)


def _remember(known: OrderedDict[K, int], key: K, event_id: int, most: int) -> None:
    known[key] = event_id
    if len(known) > most:
        known.popitem(last=False)
