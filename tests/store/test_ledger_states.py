"""A ledger's accounts through all that may be recorded, with its file lost or read again in between."""

from __future__ import annotations

import tempfile
from collections import Counter
from pathlib import Path

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from gcs_mosaic.messages import DamagedFile
from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.records import EventState, FlightRecord, FrameState
from tests.factories import frame, trigger_event

REASONED = {FrameState.REJECTED, FrameState.DUPLICATE, FrameState.DROPPED, FrameState.UNSTITCHED}
PLAIN = {FrameState.PENDING, FrameState.PLACED, FrameState.COVERED, FrameState.WAITING}


class LedgerMachine(RuleBasedStateMachine):
    def __init__(self) -> None:
        super().__init__()
        self.folder = tempfile.TemporaryDirectory()
        self.frames: dict[str, FrameState] = {}
        self.events: dict[int, EventState] = {}
        self.pairs: dict[int, str] = {}

    @initialize()
    def begin(self) -> None:
        self.ledger = Ledger(Path(self.folder.name) / LEDGER_NAME)
        self.ledger.begin_flight(FlightRecord(name="any", started_utc=1.0))

    @rule(name=st.sampled_from("abcdefgh"))
    def file(self, name: str) -> None:
        if self.frames.get(name, FrameState.DAMAGED) is FrameState.DAMAGED:
            self.ledger.record_frame(frame(name))
            self.frames[name] = FrameState.PENDING

    @rule(name=st.sampled_from("abcdefgh"))
    def damaged(self, name: str) -> None:
        if self.frames.get(name, FrameState.DAMAGED) is FrameState.DAMAGED:
            self.ledger.record_damaged(DamagedFile(name=name, reason="half a file"))
            self.frames[name] = FrameState.DAMAGED

    @precondition(lambda self: self.whole())
    @rule(data=st.data(), state=st.sampled_from(sorted(PLAIN | REASONED)))
    def settle_frame(self, data: st.DataObject, state: FrameState) -> None:
        name = data.draw(st.sampled_from(self.whole()))
        self.ledger.settle_frame(name, state, "because" if state in REASONED else None)
        self.frames[name] = state

    @precondition(lambda self: self.whole())
    @rule(data=st.data())
    def process_again(self, data: st.DataObject) -> None:
        names = data.draw(st.lists(st.sampled_from(self.whole()), unique=True))
        self.ledger.process_again(names, placed=())
        self.frames |= dict.fromkeys(names, FrameState.PENDING)

    @rule(sequence=st.integers(0, 9))
    def event(self, sequence: int) -> None:
        number = self.ledger.record_event(trigger_event(sequence))
        assert number not in self.events
        self.events[number] = EventState.PENDING

    @precondition(lambda self: self.events)
    @rule(data=st.data())
    def repeated_event(self, data: st.DataObject) -> None:
        of = data.draw(st.sampled_from(sorted(self.events)))
        self.events[self.ledger.record_event(trigger_event(), duplicate_of=of)] = EventState.DUPLICATE

    @precondition(lambda self: self.open())
    @rule(data=st.data(), state=st.sampled_from([EventState.PENDING, EventState.MISSING, EventState.FAILED]))
    def settle_event(self, data: st.DataObject, state: EventState) -> None:
        number = data.draw(st.sampled_from(self.open()))
        self.ledger.settle_event(number, state)
        self.events[number] = state
        self.pairs.pop(number, None)

    @precondition(lambda self: bool(self.open() and set(self.whole()) - set(self.pairs.values())))
    @rule(data=st.data())
    def match(self, data: st.DataObject) -> None:
        number = data.draw(st.sampled_from(self.open()))
        name = data.draw(st.sampled_from(sorted(set(self.whole()) - set(self.pairs.values()))))
        self.ledger.settle_event(number, EventState.MATCHED, frame=name)
        self.events[number], self.pairs[number] = EventState.MATCHED, name

    @rule()
    def read_again(self) -> None:
        path = self.ledger.path
        self.ledger.close()
        self.ledger = Ledger(path)

    @rule()
    def lose_the_file(self) -> None:
        self.ledger.path.unlink()
        self.ledger.write_anew()

    @invariant()
    def accounts_are_what_was_told(self) -> None:
        if not hasattr(self, "ledger"):
            return
        accounts, frames, events = self.ledger.accounts(), Counter(self.frames.values()), Counter(self.events.values())
        assert {state: getattr(accounts.frames, state) for state in FrameState} == {s: frames[s] for s in FrameState}
        assert {state: getattr(accounts.events, state) for state in EventState} == {s: events[s] for s in EventState}
        pictures = {
            name for name, state in self.frames.items() if state not in (FrameState.DUPLICATE, FrameState.DAMAGED)
        }
        assert accounts.orphans == len(pictures - set(self.pairs.values()))
        assert {one.name: one.state for one in self.ledger.frames()} == self.frames
        assert {one.name for one in self.ledger.frames() if one.had_event} == set(self.pairs.values())
        assert {one.id: one.frame for one in self.ledger.events(EventState.MATCHED)} == self.pairs

    def teardown(self) -> None:
        if hasattr(self, "ledger"):
            self.ledger.close()
        self.folder.cleanup()

    def whole(self) -> list[str]:
        return sorted(name for name, state in self.frames.items() if state is not FrameState.DAMAGED)

    def open(self) -> list[int]:
        return sorted(number for number, state in self.events.items() if state is not EventState.DUPLICATE)


TestLedger = LedgerMachine.TestCase
TestLedger.settings = settings(max_examples=15, stateful_step_count=20)
