"""The two accounts close, whatever comes in whatever order: events through merger, pairing and ledger, frames beside."""

from __future__ import annotations

import random
import sys
from collections import Counter
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs_mosaic.app.inputs.event_log import EventLog
from gcs_mosaic.app.pipeline.resuming import told_again
from gcs_mosaic.messages import CaptureResult, Frame, Source, TriggerEvent
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.records import EventState, FrameState
from gcs_mosaic.triggers import PairingSettings
from gcs_mosaic.triggers.shots import Shots, ShotSettings
from tests.factories import frame, trigger_event

NAMES = ("IMG_0.JPG", "IMG_1.JPG", "img_1.jpg", "IMG_65535.JPG", "a.jpg", "b.jpg")
WHAT = ("event", "event", "event", "frame", "frame", "copy", "tick", "save", "end of a frame")
ENDS = (FrameState.PLACED, FrameState.WAITING, FrameState.REJECTED, FrameState.DROPPED)

moves = st.tuples(
    st.sampled_from(WHAT),
    st.floats(0, 25),  # seconds since the move before
    st.none() | st.integers(0, 3) | st.integers(65533, 65536).map(lambda count: count % 65536),  # counter
    st.none() | st.floats(0, 4300),  # sender's clock, seconds since boot
    st.sampled_from([None, *NAMES]),
    st.sampled_from(list(CaptureResult)),
    st.sampled_from(list(Source)),
    st.integers(0, 3),  # which camera, which end
)


class Paper:
    """A ledger in memory that does what `Ledger` does, quick enough for thousands of flights."""

    def __init__(self) -> None:
        self.events: dict[int, tuple[EventState, str | None, int | None]] = {}
        self.frames: dict[str, FrameState] = {}
        self.in_transaction = False

    def record_event(self, event: TriggerEvent) -> int:
        self.events[len(self.events) + 1] = (EventState.PENDING, None, None)
        return len(self.events)

    def settle_event(
        self, event_id: int, state: EventState, *, frame: str | None = None, duplicate_of: int | None = None
    ) -> None:
        assert self.in_transaction
        assert frame is None or frame in self.frames
        self.events[event_id] = (state, frame, duplicate_of)

    def record_frame(self, came: Frame, state: FrameState) -> None:
        self.frames[came.name] = state

    @contextmanager
    def transaction(self) -> Iterator[None]:
        self.in_transaction = True
        yield
        self.in_transaction = False


def event(now: float, move: Any) -> TriggerEvent:
    _, _, count, boot, name, result, source, camera = move
    return trigger_event(
        count,
        now,
        component=100 if source is Source.IMAGE_CAPTURED_BY_CAMERA else 1,
        camera=camera % 2,
        source=source,
        source_time=boot,
        clock="none" if boot is None else "boot",
        result=result,
        file_hint=name,
    )


def fly(flight: list[Any], ledger: Any, record_frame: Any, settle_frame: Any) -> tuple[int, int]:
    """Let all of it happen; returns how many events and how many frames there were."""
    event_log, shots, now = EventLog(ledger, PairingSettings(remembered=6)), Shots(ShotSettings(remembered=8)), 0.0
    told, came = 0, list[Frame]()
    for move in flight:
        what, wait, *_, which = move
        now += wait
        if what == "event":
            event_log.message(shots.hear(event(now, move)), now)
            told += 1
        elif what in ("frame", "copy"):
            came.append(frame(f"{move[4] or 'y.png'}#{len(came)}", now))
            record_frame(came[-1], FrameState.DUPLICATE if what == "copy" else FrameState.PENDING)
            if what == "frame":
                event_log.frame(came[-1], now, fresh=True)
            else:
                event_log.copy(came[-1], now, of=came[which % len(came)].name)
        elif what == "tick":
            event_log.tick(now)
        elif what == "save":
            event_log.save()
        elif came:
            settle_frame(came[which % len(came)].name, ENDS[which])
    event_log.close()
    event_log.save()
    event_log.save()
    return told, len(came)


def close_on_paper(flight: list[Any]) -> None:
    ledger = Paper()
    told, came = fly(flight, ledger, ledger.record_frame, lambda name, state: None)
    states = Counter(state for state, _, _ in ledger.events.values())
    assert states.total() == told
    assert states[EventState.PENDING] == 0
    assert len(ledger.frames) == came
    owners = [name for state, name, _ in ledger.events.values() if state is EventState.MATCHED]
    assert len(owners) == len(set(owners)) == states[EventState.MATCHED]
    assert None not in owners
    for event_id, (state, name, of) in ledger.events.items():
        assert (name is not None) == (state is EventState.MATCHED)
        assert (of is not None) == (state is EventState.DUPLICATE)
        # A duplicate belongs to an earlier event that counts.
        assert of is None or (of < event_id and ledger.events[of][0] is not EventState.DUPLICATE)


@settings(max_examples=200)
@given(st.lists(moves, max_size=40))
def test_the_accounts_close_whatever_comes_in_whatever_order(flight: list[Any]) -> None:
    close_on_paper(flight)


@pytest.mark.thorough
@pytest.mark.long
def test_the_accounts_close_over_two_thousand_flights() -> None:
    """Longer ones, and more of them, than there is time to look for the shortest of; the seed is in the message."""
    for seed in range(2000):
        dice = random.Random(seed)
        try:
            close_on_paper([any_move(dice) for _ in range(seed % 40)])
        except Exception as error:
            raise AssertionError(f"flight {seed}") from error


def any_move(dice: random.Random) -> Any:
    return (
        dice.choice(WHAT),
        dice.choice((0.0, 0.1, 1.0, 2.0, 2.0, 25.0)),
        dice.choice((None, 0, 1, 2, 3, 65534, 65535)),
        dice.choice((None, None, 5.0, 4294.0, dice.uniform(0, 4300))),
        dice.choice((None, None, *NAMES)),
        dice.choice(list(CaptureResult)),
        dice.choice(list(Source)),
        dice.randrange(4),
    )


@settings(max_examples=25)
@given(flight=st.lists(moves, min_size=10, max_size=40))
def test_the_accounts_of_a_real_ledger_close(flight: list[Any], tmp_path_factory: pytest.TempPathFactory) -> None:
    with Ledger(tmp_path_factory.mktemp("ledger") / "flight.sqlite") as ledger:

        def record(came: Frame, state: FrameState) -> None:
            ledger.record_frame(came)
            if state is not FrameState.PENDING:
                ledger.settle_frame(came.name, state, "the same picture as another")

        told, came = fly(flight, ledger, record, lambda name, state: ledger.settle_frame(name, state, "because"))
        accounts, events = ledger.accounts(), ledger.events()
        states = Counter(str(record.state) for record in events)
        assert {name: getattr(accounts.events, name) for name in states} == dict(states)
        assert states.total() == told
        assert states["pending"] == 0
        ends = [getattr(accounts.frames, state.value) for state in FrameState]
        assert sum(ends) == came == len(ledger.frames())
        copies = [one for one in ledger.frames() if one.state is FrameState.DUPLICATE and not one.had_event]
        assert accounts.orphans == came - len(copies) - states["matched"], "of a copy none is to be expected"


@pytest.mark.parametrize("how", ["a slow camera clock", "asked of a stream", "written again"])
def test_what_was_matched_stays_so_in_a_resumed_flight(tmp_path: Path, how: str) -> None:
    event = trigger_event(1, 10.0, file_hint="latest.jpg" if how == "written again" else None)
    came = {
        "a slow camera clock": frame("a.jpg", 11.0, modified=500.0),
        "asked of a stream": frame("stream/a.jpg", 40.0, modified=2000.0, taken_for=event),
        "written again": frame("latest.jpg#2", 40.0, path=tmp_path / "frames/latest.jpg#2"),
    }[how]
    with closing(Ledger(tmp_path / "flight.sqlite")) as ledger:
        shots, log = Shots(ShotSettings()), EventLog(ledger, PairingSettings())
        log.message(shots.hear(event), event.received)
        for later in (came, frame("b.jpg", 200.0, modified=500.0)):
            ledger.record_frame(later)
            log.frame(later, later.received, fresh=True)
        log.save()
        before = ledger.events()
        assert before[0].frame == came.name
        log = EventLog(ledger, PairingSettings())
        log.resume(told_again(before, ledger.frames(), []), Shots(ShotSettings()), 1000.0, tmp_path)
        log.save()
        assert ledger.events() == before


def test_of_the_frames_that_are_remembered_no_file_stays_in_memory(tmp_path: Path) -> None:
    """Of a long flight that would be gigabytes."""
    whole = bytes(bytearray(b"a file"))  # an object of its own, whose references can be counted
    with closing(Ledger(tmp_path / "flight.sqlite")) as ledger:
        shots, log = Shots(ShotSettings()), EventLog(ledger, PairingSettings())
        log.message(shots.hear(trigger_event(received=100.0, file_hint="a.jpg")), 100.0)
        for name in ("a.jpg", "an orphan.jpg"):
            came = frame(name, 101.0, data=whole)
            ledger.record_frame(came)
            before = sys.getrefcount(whole)
            log.frame(came, came.received, fresh=True)
            log.save()
            assert sys.getrefcount(whole) == before
        assert ledger.events()[0].frame == "a.jpg", "it is remembered"


def test_a_copy_tells_the_frame_by_another_name_after_a_restart_too(tmp_path: Path) -> None:
    """As where a program renames what it has received: the event is about the frame that is on the map."""
    with closing(Ledger(tmp_path / "flight.sqlite")) as ledger:
        first, again = frame("upload.jpg", 1000.0), frame("a.jpg", 1001.0)
        shots, log = Shots(ShotSettings()), EventLog(ledger, PairingSettings())
        ledger.record_frame(first)
        log.frame(first, 1000.0, fresh=True)
        ledger.record_frame(again)
        ledger.settle_frame("a.jpg", FrameState.DUPLICATE, "the same picture as upload.jpg")
        log.copy(again, again.received, of="upload.jpg")
        assert ledger.accounts().orphans == 1
        log = EventLog(ledger, PairingSettings())
        log.resume(told_again([], ledger.frames(), []), Shots(ShotSettings()), 0.0, tmp_path)
        log.message(shots.hear(trigger_event(received=1002.0, file_hint="a.jpg")), 1002.0)
        log.save()
        assert [one.frame for one in ledger.events()] == ["upload.jpg"]
        assert ledger.accounts().orphans == 0
