from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs_mosaic.messages import CaptureResult, Frame, Source, TriggerEvent
from gcs_mosaic.triggers import Failed, How, Matched, Missing, Orphan, Outcome, Pairing, PairingSettings, Unmatched
from gcs_mosaic.triggers.clocks import SourceClocks
from tests.factories import frame, trigger_event


def shot(at: float, sequence: int | None = None, hint: str | None = None, **fields: Any) -> TriggerEvent:
    return trigger_event(sequence, at, file_hint=hint, **fields)


def file(at: float, name: str) -> Frame:
    return frame(name, at)


class Flight:
    """A pairing that is told events and frames in the order of their times, ids being the shots' numbers."""

    def __init__(self, **limits: float) -> None:
        self.pairing = Pairing(PairingSettings(**limits))  # type: ignore[arg-type]
        self.clocks = SourceClocks()
        self.outcomes: list[Outcome] = []

    def fly(self, *items: tuple[int, TriggerEvent] | Frame) -> Flight:
        for item in sorted(items, key=lambda item: item.received if isinstance(item, Frame) else item[1].received):
            if isinstance(item, Frame):
                self.outcomes += self.pairing.frame(item, item.received)
            else:
                self.outcomes += self.pairing.event(*item, self.clocks.moment(item[1]), item[1].received)
        return self

    def pairs(self) -> dict[int, str]:
        """Event id -> name of the frame that it ended with."""
        ended: dict[int, str] = {}
        for outcome in self.outcomes:
            if isinstance(outcome, Matched):
                ended[outcome.event_id] = outcome.frame.name
            elif isinstance(outcome, Unmatched):
                del ended[outcome.event_id]
        return ended


def shots(count: int, every: float = 2.0, hint: str = "") -> list[tuple[int, TriggerEvent]]:
    return [(n, shot(every * n, 100 + n, hint.format(n) or None)) for n in range(count)]


def files(count: int, name: str, late: float = 1.0, every: float = 2.0) -> list[Frame]:
    return [file(every * n + late, name.format(n)) for n in range(count)]


def test_a_file_name_decides_whatever_the_times_say() -> None:
    flight = Flight().fly(*shots(5, hint="IMG_{}.JPG"), *(file(100.0 - n, f"dcim/img_{n}.jpg") for n in range(5)))
    assert flight.pairs() == {n: f"dcim/img_{n}.jpg" for n in range(5)}
    assert {outcome.how for outcome in flight.outcomes if isinstance(outcome, Matched)} == {How.NAME}


def test_the_exact_name_is_preferred_to_the_nearly_equal_one() -> None:
    flight = Flight().fly(file(1.0, "A.jpg"), file(2.0, "a.jpg"), (0, shot(3.0, hint="A.jpg")))
    assert flight.pairs() == {0: "A.jpg"}


def test_an_overwritten_name_belongs_to_the_newer_event() -> None:
    flight = Flight().fly(
        (0, shot(0.0, hint="a.jpg")), file(1.0, "a.jpg"), (1, shot(9.0, hint="a.jpg")), file(9.5, "a.jpg#2")
    )
    assert flight.pairs() == {0: "a.jpg", 1: "a.jpg#2"}


def test_a_name_undoes_a_match_by_time() -> None:
    flight = Flight().fly((0, shot(0.0, hint="b.jpg")), file(1.0, "a.jpg"), file(2.0, "b.jpg"))
    assert flight.pairs() == {0: "b.jpg"}
    assert [type(outcome) for outcome in flight.outcomes] == [Matched, Unmatched, Matched]


def test_a_better_witness_names_the_file_later() -> None:
    flight = Flight().fly((0, shot(0.0)), (1, shot(2.0)), file(2.5, "x.jpg"))
    assert flight.pairs() == {0: "x.jpg"}
    flight.outcomes += flight.pairing.improve(1, shot(2.6, hint="x.jpg"), 2.6)
    assert flight.pairs() == {1: "x.jpg"}
    assert flight.pairing.accounts().duplicate == 1


@pytest.mark.parametrize("late", [0.3, 1.9, 5.0, 13.0])
def test_without_names_frames_come_in_the_order_of_their_shots(late: float) -> None:
    flight = Flight().fly(*shots(20), *files(20, "{}-a.jpg", late))
    assert flight.pairs() == {n: f"{n}-a.jpg" for n in range(20)}


def test_a_late_event_finds_the_frame_that_came_before_it() -> None:
    flight = Flight().fly(file(10.0, "a.jpg"), (0, shot(11.0)))
    assert [type(outcome) for outcome in flight.outcomes] == [Orphan, Matched]


def test_a_missing_frame_costs_no_other_its_event() -> None:
    frames = [frame for frame in files(20, "{}x.jpg") if frame.name != "7x.jpg"]
    flight = Flight().fly(*shots(20), *frames)
    assert flight.pairs() == {n: f"{n}x.jpg" for n in range(20) if n != 7}


def test_a_missing_event_costs_no_other_its_frame() -> None:
    flight = Flight().fly(*(event for event in shots(20) if event[0] != 7), *files(20, "{}x.jpg"))
    assert flight.pairs() == {n: f"{n}x.jpg" for n in range(20) if n != 7}


def test_a_lost_first_frame_is_noticed_at_the_end_of_the_first_line() -> None:
    def line(n: int) -> float:
        return 2.0 * n + 10.0 * (n // 8)  # a turn after every eighth shot

    events = [(n, shot(line(n))) for n in range(40)]
    flight = Flight().fly(*events, *(file(line(n) + 1.0, f"{n}x.jpg") for n in range(1, 40)))
    assert {n: name for n, name in flight.pairs().items() if n >= 24} == {n: f"{n}x.jpg" for n in range(24, 40)}


def test_counters_decide_when_files_come_late_and_out_of_order() -> None:
    late = [file(60.0 + 0.1 * (7 * n % 10), f"IMG_{n:04}.JPG") for n in range(10, 20)]
    flight = Flight().fly(*shots(20), *files(10, "IMG_{:04}.JPG"), *late)
    assert flight.pairs() == {n: f"IMG_{n:04}.JPG" for n in range(20)}


def test_a_camera_that_counts_on_without_a_trigger_is_followed_again() -> None:
    frames = [file(2.0 * n + 1.0, f"IMG_{n + (n >= 8):04}.JPG") for n in range(20)] + [file(15.9, "IMG_0008.JPG")]
    pairs = Flight().fly(*shots(20), *frames).pairs()
    assert pairs == {n: f"IMG_{n + (n >= 8):04}.JPG" for n in range(20)}


def test_a_camera_that_misses_a_shot_is_followed_again() -> None:
    frames = [file(2.0 * n + 1.0, f"IMG_{n - (n > 8):04}.JPG") for n in range(20) if n != 8]
    pairs = Flight().fly(*shots(20), *frames).pairs()
    assert pairs == {n: f"IMG_{n - (n > 8):04}.JPG" for n in range(20) if n != 8}


def test_a_file_counter_that_begins_anew_is_followed() -> None:
    frames = [file(2.0 * n + 1.0, f"{100 + n // 10}/DJI_{n % 10 + 1:04}.JPG") for n in range(20)]
    assert Flight().fly(*shots(20), *frames).pairs() == {n: frame.name for n, frame in enumerate(frames)}


def test_an_event_counter_that_begins_anew_is_followed() -> None:
    events = [(n, shot(2.0 * n, n % 10)) for n in range(20)]
    assert Flight().fly(*events, *files(20, "IMG_{:04}.JPG")).pairs() == {n: f"IMG_{n:04}.JPG" for n in range(20)}


@pytest.mark.parametrize("first", [1, 30])
def test_a_camera_that_begins_anew_with_other_numbers_gives_no_shot_the_file_before(first: int) -> None:
    """A change of batteries: it counts from 0, and its files from 1, where both were alike before."""
    before = [
        item for n in range(20) for item in ((n, shot(2.0 * n, first + n)), file(2.0 * n + 1, f"A/{first + n:04}.JPG"))
    ]
    after = [
        item for n in range(20) for item in ((20 + n, shot(99 + 2.0 * n, n)), file(100 + 2.0 * n, f"B/{n + 1:04}.JPG"))
    ]
    flight = Flight().fly(*before, *after)
    assert not any(isinstance(outcome, Unmatched) for outcome in flight.outcomes)
    assert [flight.pairs()[20 + n] for n in range(20)] == [f"B/{n + 1:04}.JPG" for n in range(20)]


def test_a_shot_that_is_told_of_late_is_no_counter_that_begins_anew() -> None:
    """Of the third was told on request, when the twentieth had been taken."""
    items = [item for n in range(20) for item in ((n, shot(2.0 * n, n)), file(2.0 * n + 1, f"{n:04}.JPG"))]
    flight = Flight()
    flight.clocks = SourceClocks()
    for item in items:
        if isinstance(item, Frame) or item[0] != 3:
            flight.fly(item)
    flight.outcomes += flight.pairing.event(3, shot(39.5, 3), 6.0, 39.5)
    flight.fly((20, shot(40.0, 20)), (21, shot(40.8, 21)), file(41.0, "0021.JPG"), file(41.8, "0020.JPG"))
    assert flight.pairs() == {n: f"{n:04}.JPG" for n in range(22)}


def test_a_frame_that_was_there_at_the_start_is_not_matched_by_its_time() -> None:
    pairing = Pairing()
    pairing.event(0, shot(10.0), 10.0, 10.0)
    assert pairing.frame(file(10.5, "old.jpg"), 10.5, fresh=False) == [Orphan(file(10.5, "old.jpg"))]
    assert [type(outcome) for outcome in pairing.event(1, shot(11.0, hint="old.jpg"), 11.0, 11.0)] == [Matched]


def test_an_event_is_missing_after_a_while_and_may_still_be_matched() -> None:
    flight = Flight(missing_after_s=60.0).fly((0, shot(0.0, hint="a.jpg")))
    assert flight.pairing.tick(59.0) == []
    assert flight.pairing.tick(60.0) == [Missing(0, shot(0.0, hint="a.jpg"))]
    assert flight.pairing.tick(99.0) == []
    assert flight.fly(file(500.0, "a.jpg")).pairs() == {0: "a.jpg"}
    assert flight.pairing.accounts().missing == 0


def test_a_failed_shot_waits_for_no_frame() -> None:
    flight = Flight().fly((0, shot(0.0, result=CaptureResult.FAILED)), file(1.0, "a.jpg"))
    assert [type(outcome) for outcome in flight.outcomes] == [Failed, Orphan]
    assert flight.pairing.accounts().failed == 1


def test_a_shot_that_turns_out_to_have_failed_gives_its_frame_back() -> None:
    flight = Flight().fly((0, shot(0.0)), file(1.0, "a.jpg"))
    outcomes = flight.pairing.improve(0, shot(1.5, result=CaptureResult.FAILED), 1.5)
    assert [type(outcome) for outcome in outcomes] == [Unmatched, Failed]


def test_at_the_end_what_is_pending_is_missing() -> None:
    flight = Flight().fly(*shots(3), file(1.0, "a.jpg"))
    assert [getattr(outcome, "event_id", None) for outcome in flight.pairing.close()] == [1, 2]
    accounts = flight.pairing.accounts()
    assert (accounts.events, accounts.matched, accounts.missing, accounts.pending) == (3, 1, 2, 0)


def test_an_id_or_a_name_that_comes_twice_is_a_mistake_of_the_caller() -> None:
    flight = Flight().fly((0, shot(0.0)), file(1.0, "a.jpg"))
    with pytest.raises(ValueError, match="event 0"):
        flight.fly((0, shot(2.0)))
    with pytest.raises(ValueError, match=r"frame a\.jpg"):
        flight.fly(file(2.0, "a.jpg"))


def test_what_is_remembered_is_bounded_and_what_is_given_up_is_said() -> None:
    flight = Flight(remembered=10).fly(*shots(1000, every=0.001))
    assert sum(isinstance(outcome, Missing) for outcome in flight.outcomes) == 990
    assert flight.pairing.accounts().pending == 10


@pytest.mark.parametrize("lost", ["to another", "altogether"])
def test_an_event_that_was_given_up_and_loses_its_frame_is_missing(lost: str) -> None:
    """It stayed pending for ever: nothing looked at it any more."""
    flight = Flight(remembered=1).fly((0, shot(0.0)), file(1.0, "a.jpg"), (1, shot(2.0)))
    assert flight.pairs() == {0: "a.jpg"}
    outcomes = flight.pairing.known(1, "a.jpg") if lost == "to another" else flight.pairing.withdraw("a.jpg")
    assert Missing(0, shot(0.0)) in outcomes


sequences = st.none() | st.integers(0, 5)
names = st.sampled_from(["IMG_0.JPG", "img_0.jpg", "IMG_1.JPG", "IMG_2.JPG", "x.jpg"])
steps = st.lists(
    st.tuples(
        st.sampled_from(["event", "event", "frame", "frame", "improve", "duplicate", "tick"]),
        st.floats(0, 20),
        sequences,
        st.none() | names,
        st.sampled_from(list(CaptureResult)),
        st.sampled_from(list(Source)),
        st.integers(0, 30),
    ),
    max_size=40,
)


@pytest.mark.long
@settings(max_examples=400)
@given(steps, st.sampled_from([3, 5000]))
def test_the_accounts_close_whatever_comes(steps: list[Any], remembered: int) -> None:
    pairing, now, told, came = Pairing(PairingSettings(remembered=remembered)), 0.0, 0, 0
    state: dict[int, str] = {}
    owner: dict[str, int] = {}
    for what, wait, sequence, name, result, source, which in [*steps, ("close", 0, None, None, None, None, 0)]:
        now += wait
        event = shot(now, sequence, name, result=result, source=source) if source else None
        outcomes: list[Outcome] = []
        if what == "event" and event:
            state[told] = "pending"
            outcomes, told = pairing.event(told, event, now, now), told + 1
        elif what == "improve" and event:
            outcomes = pairing.improve(which, event, now)
            state[1000 + told] = "duplicate"
            told += 1
        elif what == "duplicate":
            pairing.duplicate()
            state[1000 + told] = "duplicate"
            told += 1
        elif what == "frame":
            outcomes, came = pairing.frame(file(now, f"{name or 'y.jpg'}#{came}"), now, fresh=which > 3), came + 1
        elif what == "tick":
            outcomes = [*pairing.tick(now)]
        else:
            outcomes = pairing.close()
        for outcome in outcomes:
            check_and_note(outcome, state, owner)
        accounts = pairing.accounts()
        assert accounts.events == told == len(state)
        assert accounts.frames == came
        assert accounts.matched == len(owner) == list(state.values()).count("matched")
        for kind in ("pending", "missing", "failed", "duplicate"):
            assert getattr(accounts, kind) == list(state.values()).count(kind)
    assert pairing.accounts().pending == 0


def check_and_note(outcome: Outcome, state: dict[int, str], owner: dict[str, int]) -> None:
    """Every outcome follows from the ones before it."""
    match outcome:
        case Matched(event_id, _, frame, _):
            assert state[event_id] in ("pending", "missing")
            assert frame.name not in owner
            state[event_id], owner[frame.name] = "matched", event_id
        case Unmatched(event_id, frame):
            assert owner.pop(frame.name) == event_id
            state[event_id] = "pending"
        case Missing(event_id, _):
            assert state[event_id] == "pending"
            state[event_id] = "missing"
        case Failed(event_id, _):
            state[event_id] = "failed"
        case Orphan(frame):
            assert frame.name not in owner


def test_a_frame_that_its_event_gives_up_for_the_named_one_finds_another() -> None:
    flight = Flight().fly((0, shot(0.0)), file(0.5, "a.jpg"), (1, shot(0.6)))
    flight.outcomes += flight.pairing.frame(file(0.7, "b.jpg"), 0.7, fresh=False)
    flight.outcomes += flight.pairing.improve(0, shot(0.8, hint="b.jpg"), 0.8)
    assert flight.pairs() == {0: "b.jpg", 1: "a.jpg"}


def test_a_frame_that_is_given_up_stays_with_the_robbed_event_that_names_it() -> None:
    """A camera overwrites its one file; which frame the second shot had is known from before a restart."""
    flight = Flight().fly((0, shot(0.0, hint="b.jpg")), (1, shot(20.0, hint="b.jpg")), file(20.5, "b.jpg"))
    flight.fly((2, shot(22.0)), file(22.5, "a.jpg"))
    flight.outcomes += flight.pairing.improve(2, shot(23.0, hint="b.jpg"), 23.0)
    assert flight.pairs() == {1: "b.jpg", 2: "a.jpg"}
    flight.outcomes += flight.pairing.known(1, "a.jpg")
    assert flight.pairs() == {1: "a.jpg", 2: "b.jpg"}


@pytest.mark.parametrize("name", ["DSC{:05d}.JPG", "dsc{:05d}.jpg", "sub/DSC{:05d}_W.JPG"])
def test_a_raw_picture_that_is_named_means_the_file_of_its_stem(name: str) -> None:
    """The camera names DSC00501.ARW and delivers DSC00501.JPG; two were lost. Every pair was one off."""
    frames = [file(600.0 + n, name.format(n)) for n in range(10) if n not in (0, 4)]
    pairs = Flight().fly(*shots(10, hint="DSC{:05d}.ARW"), *frames).pairs()
    assert pairs == {n: name.format(n) for n in range(10) if n not in (0, 4)}


def test_the_size_in_the_names_is_no_counter() -> None:
    frames = files(10, "frame_{:06d}_1920x1080.jpg")
    assert Flight().fly(*shots(10), *frames).pairs() == {n: f"frame_{n:06d}_1920x1080.jpg" for n in range(10)}
    late = [file(60.0 + 0.1 * (7 * n % 10), f"frame_{n:06d}_1920x1080.jpg") for n in range(10, 20)]
    pairs = Flight().fly(*shots(20), *frames, *late).pairs()
    assert pairs == {n: f"frame_{n:06d}_1920x1080.jpg" for n in range(20)}


def dated(frame: Frame, captured: float) -> Frame:
    return replace(frame, captured=captured)


IRREGULAR = [0.0, 3.0, 5.0, 11.0, 13.0, 20.0, 24.0, 25.5, 31.0, 36.0, 41.5, 44.0, 50.0, 53.0, 57.5, 60.0]


def test_the_cameras_clock_tells_after_landing_what_times_of_arrival_cannot() -> None:
    """A card is copied; names and counters have nothing in common, three files are lost, and the clock is an hour off."""
    frames = [
        dated(file(300.0 + n, f"{chr(65 + n)}-x.jpg"), 3600.4 + IRREGULAR[n]) for n in range(16) if n not in (0, 6, 7)
    ]
    flight = Flight().fly(*((n, shot(at)) for n, at in enumerate(IRREGULAR)), *frames)
    assert flight.pairs() == {}
    flight.outcomes += flight.pairing.close()
    assert flight.pairs() == {n: f"{chr(65 + n)}-x.jpg" for n in range(16) if n not in (0, 6, 7)}
    assert not flight.pairing.doubts


def test_pairs_that_the_cameras_clock_contradicts_are_corrected_in_flight() -> None:
    """A slow link brings files in bursts, one in four late, so that by arrival some belong to the shot after."""
    moments = [2.0 * n + (3.0 if n >= 12 else 0.0) + 0.7 * (n % 3) for n in range(40)]
    frames = [dated(file(at + (2.6 if n % 4 == 2 else 0.8), f"{n}-x.jpg"), at + 99.0) for n, at in enumerate(moments)]
    flight = Flight().fly(*((n, shot(at)) for n, at in enumerate(moments)), *frames)
    assert {n: name for n, name in flight.pairs().items() if n < 22} == {n: f"{n}-x.jpg" for n in range(22)}
    flight.outcomes += flight.pairing.close()
    assert flight.pairs() == {n: f"{n}-x.jpg" for n in range(40)}


@pytest.mark.parametrize("early", [False, True])
@pytest.mark.parametrize("order", ["01", "10"])
def test_of_files_of_one_name_the_one_in_the_folder_that_is_told_is_meant(order: str, *, early: bool) -> None:
    """A camera that begins a new folder begins to count anew; its files are copied after the messages, or come before them."""
    told = [(n, shot(20.0 + n, hint=f"10{n}MEDIA/DJI_0001.JPG")) for n in (1, 0)]
    first = 19.0 if early else 40.0
    files_there = [file(first + 0.1 * n, f"card/10{folder}media/DJI_0001.JPG") for n, folder in enumerate(order)]
    assert Flight().fly(*told, *files_there).pairs() == {n: f"card/10{n}media/DJI_0001.JPG" for n in (0, 1)}


def test_a_file_that_lies_in_another_folder_than_was_told_is_taken_all_the_same() -> None:
    flight = Flight().fly(
        (0, shot(0.0, hint="100MEDIA/a.jpg")),
        file(1.0, "a.jpg"),
        (1, shot(2.0, hint="b.jpg")),
        file(3.0, "sorted/b.jpg"),
    )
    assert flight.pairs() == {0: "a.jpg", 1: "sorted/b.jpg"}
