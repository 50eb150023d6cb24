"""What became of every camera event: messages about one shot become one, shots find their frames, the ledger knows all."""

from __future__ import annotations

import logging
from collections import OrderedDict

from gcs_mosaic.messages import Frame, TriggerEvent
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.records import EventState
from gcs_mosaic.triggers import Failed, Matched, Missing, Outcome, Pairing, PairingSettings, Unmatched
from gcs_mosaic.triggers.shots import Better, Duplicate, New, ShotMerger, ShotSettings

logger = logging.getLogger(__name__)


class EventLog:
    """Matches events with frames, and writes what becomes of them into the ledger with `save`."""

    def __init__(self, ledger: Ledger, shots: ShotSettings, pairing: PairingSettings) -> None:
        self._ledger = ledger
        self._merger = ShotMerger(shots)
        self._pairing = Pairing(pairing)
        self._duplicates: list[tuple[int, int]] = []
        self._outcomes: list[Outcome] = []
        self._ids: OrderedDict[TriggerEvent, int] = OrderedDict()  # of the shot that an event told of
        self._remembered = pairing.remembered

    def event(self, event: TriggerEvent, now: float) -> None:
        """A camera message has come. After DiskFull nothing has happened: tell it again."""
        event_id = self._ledger.record_event(event)
        verdict = self._merger.add(event_id, event)
        self._remember(event, event_id if isinstance(verdict, New) else verdict.of)
        match verdict:
            case New():
                self._outcomes += self._pairing.event(event_id, event, now)
            case Duplicate(of):
                self._pairing.duplicate()
                self._duplicates.append((event_id, of))
            case Better(of):
                self._duplicates.append((event_id, of))
                self._outcomes += self._pairing.improve(of, event, now)

    def frame(self, frame: Frame, now: float, *, fresh: bool) -> None:
        """A frame has come and stands in the ledger; `fresh` if it was not there before the watch began."""
        asked_by = self._ids.get(frame.taken_for) if frame.taken_for else None
        self._outcomes += self._pairing.frame(frame, now, fresh=fresh, asked_by=asked_by)

    def tick(self, now: float) -> list[Missing]:
        """Time has passed; returns the events whose frames are missing now."""
        missing = self._pairing.tick(now)
        for event in missing:
            logger.info("no frame has come for %s", event.event)
        self._outcomes += missing
        return missing

    def close(self) -> None:
        """Nothing more will come."""
        self._outcomes += self._pairing.close()

    def save(self) -> None:
        """Write what is new. After DiskFull call it again."""
        if not self._outcomes and not self._duplicates:
            return
        with self._ledger.transaction():
            for event_id, of in self._duplicates:
                self._ledger.settle_event(event_id, EventState.DUPLICATE, duplicate_of=of)
            for outcome in self._outcomes:
                self._write(outcome)
        self._duplicates.clear()
        self._outcomes.clear()

    def _remember(self, event: TriggerEvent, shot: int) -> None:
        self._ids[event] = shot
        if len(self._ids) > self._remembered:
            self._ids.popitem(last=False)

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
