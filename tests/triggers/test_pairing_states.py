"""Events and frames in any order, renamed, withdrawn and remembered: each event has one outcome, no frame has two events."""

from __future__ import annotations

from collections.abc import Iterable

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from gcs_mosaic.messages import CaptureResult, Source, TriggerEvent
from gcs_mosaic.triggers import Failed, Matched, Missing, Orphan, Outcome, Pairing, PairingSettings, Unmatched
from tests.factories import frame, trigger_event

names = st.sampled_from(["IMG_0.JPG", "img_0.jpg", "IMG_1.JPG", "IMG_2.JPG", "IMG_2.DNG", "x.jpg"])
told = st.builds(
    lambda sequence, hint, result, source: trigger_event(
        sequence, file_hint=hint, result=result, source=source, component=100 if hint else 1
    ),
    st.none() | st.integers(0, 5),
    st.none() | names,
    st.sampled_from(list(CaptureResult)),
    st.sampled_from(list(Source)),
)
EVERYTHING, LITTLE = 5000, 3  # events and frames that are remembered


class PairingMachine(RuleBasedStateMachine):
    def __init__(self) -> None:
        super().__init__()
        self.now, self.came, self.messages = 0.0, 0, 0
        self.state: dict[int, str] = {}  # of each event
        self.owner: dict[str, int] = {}  # the event of each frame that has one
        self.frames: list[str] = []

    @initialize(remembered=st.sampled_from([EVERYTHING, EVERYTHING, LITTLE]))
    def begin(self, remembered: int) -> None:
        self.pairing = Pairing(PairingSettings(remembered=remembered))
        self.remembers_all = remembered == EVERYTHING  # what is not remembered cannot be taken back either

    @rule(seconds=st.floats(0, 20))
    def wait(self, seconds: float) -> None:
        self.now += seconds
        self.follow(self.pairing.tick(self.now))

    @rule(event=told)
    def event(self, event: TriggerEvent) -> None:
        number = len(self.state)
        self.state[number] = "pending"
        self.messages += 1
        self.follow(self.pairing.event(number, self.at_once(event), self.now, self.now))

    @precondition(lambda self: self.state)
    @rule(event=told, data=st.data())
    def more_of_an_event(self, event: TriggerEvent, data: st.DataObject) -> None:
        self.messages += 1
        self.follow(self.pairing.improve(self.an_event(data), self.at_once(event), self.now))

    @precondition(lambda self: self.state)
    @rule(event=told, data=st.data())
    def the_same_of_an_event(self, event: TriggerEvent, data: st.DataObject) -> None:
        self.messages += 1
        self.pairing.duplicate(self.an_event(data), self.at_once(event))

    @rule(name=names, fresh=st.booleans())
    def frame(self, name: str, fresh: bool) -> None:
        self.follow(self.pairing.frame(frame(self.new(name), self.now), self.now, fresh=fresh))

    @precondition(lambda self: self.state)
    @rule(name=names, data=st.data())
    def frame_that_an_event_asked_for(self, name: str, data: st.DataObject) -> None:
        self.follow(self.pairing.frame(frame(self.new(name), self.now), self.now, asked_by=self.an_event(data)))

    @precondition(lambda self: self.frames and self.remembers_all)
    @rule(data=st.data())
    def a_frame_was_none(self, data: st.DataObject) -> None:
        name = data.draw(st.sampled_from(self.frames))
        self.frames.remove(name)
        self.follow(self.pairing.withdraw(name))

    @precondition(lambda self: self.frames and self.remembers_all)
    @rule(name=names, data=st.data())
    def the_whole_picture_of_a_preview(self, name: str, data: st.DataObject) -> None:
        preview = data.draw(st.sampled_from(self.frames))
        self.frames.remove(preview)
        whole, event = frame(self.new(name), self.now), self.owner.pop(preview, None)
        (outcome,) = self.pairing.whole_of(preview, whole)
        if event is not None:
            self.owner[whole.name] = event
            assert isinstance(outcome, Matched)
            assert outcome.event_id == event
        assert isinstance(outcome, Matched | Orphan)
        assert outcome.frame.name == whole.name

    @precondition(lambda self: self.state and self.frames)
    @rule(data=st.data())
    def a_pair_of_before_a_restart(self, data: st.DataObject) -> None:
        self.follow(self.pairing.known(self.an_event(data), data.draw(st.sampled_from(self.frames))))

    @invariant()
    def accounts_close(self) -> None:
        accounts, states = self.pairing.accounts(), list(self.state.values())
        assert (accounts.events, accounts.frames) == (self.messages, len(self.frames))
        assert accounts.matched == len(self.owner) == len(set(self.owner.values()))
        for state in ("pending", "matched", "missing", "failed"):
            assert getattr(accounts, state) == states.count(state)

    def teardown(self) -> None:
        if hasattr(self, "pairing"):
            self.follow(self.pairing.close())
            self.accounts_close()
            assert self.pairing.accounts().pending == 0

    def an_event(self, data: st.DataObject) -> int:
        return data.draw(st.sampled_from(sorted(self.state)))

    def at_once(self, event: TriggerEvent) -> TriggerEvent:
        return trigger_event(**{name: getattr(event, name) for name in event.__slots__} | {"received": self.now})

    def new(self, name: str) -> str:
        self.came += 1
        self.frames.append(f"{name}#{self.came}")
        return self.frames[-1]

    def follow(self, outcomes: Iterable[Outcome]) -> None:
        """Each follows from those before."""
        for outcome in outcomes:
            match outcome:
                case Matched(event_id, _, frame, _):
                    assert self.state[event_id] in ("pending", "missing")
                    assert frame.name not in self.owner
                    self.state[event_id], self.owner[frame.name] = "matched", event_id
                case Unmatched(event_id, frame):
                    assert self.owner.pop(frame.name) == event_id
                    self.state[event_id] = "pending"
                case Missing(event_id, _):
                    assert self.state[event_id] == "pending"
                    self.state[event_id] = "missing"
                case Failed(event_id, _):
                    assert self.state[event_id] in ("pending", "missing")
                    self.state[event_id] = "failed"
                case Orphan(frame):
                    assert frame.name not in self.owner


TestPairing = PairingMachine.TestCase
TestPairing.settings = settings(max_examples=60, stateful_step_count=30)
