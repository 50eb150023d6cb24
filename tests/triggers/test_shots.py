from __future__ import annotations

import random
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_mosaic.mavlink.messages import decode
from gcs_mosaic.messages import CaptureResult, Source, TriggerEvent
from gcs_mosaic.triggers.shots import Better, Duplicate, New, ShotMerger, Verdict
from tests.factories import trigger_event
from tests.mavlink.mavlink_peer import captured, feedback, received, trigger

TRIGGER, FEEDBACK, AUTOPILOT, CAMERA = Source


def told(source: Source, sequence: int | None, received: float, source_time: float | None = None) -> TriggerEvent:
    component, clock = 100 if source is CAMERA else 1, "none" if source_time is None else "boot"
    return trigger_event(sequence, received, component=component, source=source, source_time=source_time, clock=clock)


def verdicts(*events: TriggerEvent) -> list[Verdict]:
    merger = ShotMerger()
    return [merger.add(index, event) for index, event in enumerate(events)]


def test_the_same_packet_over_two_links_is_a_duplicate() -> None:
    assert verdicts(told(TRIGGER, 5, 10.0, 70.0), told(TRIGGER, 5, 10.4, 70.0)) == [New(), Duplicate(0)]


def test_a_repetition_long_after_is_a_duplicate() -> None:
    first, second = told(CAMERA, 5, 10.0, 70.0), told(CAMERA, 6, 12.0, 72.0)
    assert verdicts(first, second, replace(first, received=500.0)) == [New(), New(), Duplicate(0)]


@pytest.mark.parametrize("again", [0, 3, 5])
def test_a_counter_that_goes_backwards_is_a_new_session(again: int) -> None:
    events = [told(TRIGGER, seq, 2.0 * seq, 100 + 2.0 * seq) for seq in range(6)]
    assert verdicts(*events, told(TRIGGER, again, 20.0, 120.0)) == [New()] * 7


def test_a_packet_out_of_order_is_a_shot_and_its_repetition_a_duplicate() -> None:
    events = [told(TRIGGER, seq, 10.0 + at, 70.0 + seq) for at, seq in enumerate((1, 3, 2, 3, 2))]
    assert verdicts(*events) == [New(), New(), New(), Duplicate(1), Duplicate(2)]


def test_a_counter_that_wraps_goes_on() -> None:
    events = [told(FEEDBACK, seq % 65536, 2.0 * seq, 2.0 * seq) for seq in range(65530, 65540)]
    assert verdicts(*events) == [New()] * 10


def test_without_any_time_a_repetition_is_one_only_for_a_while() -> None:
    events = told(TRIGGER, 0, -2.0), told(TRIGGER, 1, 0.0), told(TRIGGER, 1, 30.0), told(TRIGGER, 1, 500.0)
    assert verdicts(*events) == [New(), New(), Duplicate(1), New()]


def test_a_failed_attempt_and_the_next_picture_may_have_one_index() -> None:
    failed = replace(told(CAMERA, 5, 10.0), result=CaptureResult.FAILED)
    assert verdicts(failed, replace(told(CAMERA, 5, 12.0), result=CaptureResult.TAKEN)) == [New(), New()]


def test_the_better_witness_is_believed_whoever_comes_first() -> None:
    assert verdicts(told(TRIGGER, 0, 10.0), told(AUTOPILOT, 9, 10.1), told(CAMERA, 4, 10.5)) == [
        New(),
        Better(0),
        Better(0),
    ]
    assert verdicts(told(CAMERA, 4, 10.0), told(AUTOPILOT, 9, 10.1), told(TRIGGER, 0, 10.5)) == [
        New(), Duplicate(0), Duplicate(0),
    ]  # fmt: skip


def test_two_shots_of_one_source_are_never_one() -> None:
    assert verdicts(told(CAMERA, 1, 10.0), told(CAMERA, 2, 10.01), told(FEEDBACK, 7, 10.02), told(FEEDBACK, 8, 10.03)) == [
        New(), New(), Duplicate(1), Duplicate(0),
    ]  # fmt: skip


def test_two_cameras_on_one_aircraft_take_two_pictures() -> None:
    assert verdicts(told(CAMERA, 1, 10.0), replace(told(CAMERA, 1, 10.1), component=101)) == [New(), New()]


def test_two_aircraft_are_never_mixed() -> None:
    assert verdicts(told(TRIGGER, 1, 10.0), replace(told(CAMERA, 1, 10.1), vehicle=2)) == [New(), New()]


def test_counters_decide_where_times_would_mislead() -> None:
    learnt = [
        told(source, seq + at, 2.0 * seq + 0.1 * at) for seq in range(5) for at, source in ((0, FEEDBACK), (5, CAMERA))
    ]
    late = [told(FEEDBACK, 5, 10.0), told(FEEDBACK, 6, 12.0), told(CAMERA, 10, 12.1), told(CAMERA, 11, 12.2)]
    assert verdicts(*learnt, *late)[10:] == [New(), New(), Better(10), Better(11)]


def test_a_counter_whose_offset_is_known_does_not_reach_for_a_shot_of_long_ago() -> None:
    """The autopilot lost a shot and the camera was switched off for a minute: its number still fits, but not the time."""
    learnt = [told(source, seq, 2.0 * seq + 0.1 * source) for seq in range(5) for source in (FEEDBACK, CAMERA)]
    late = [told(FEEDBACK, 5, 10.0), told(CAMERA, 5, 10.0 + 31.0)]
    assert verdicts(*learnt, *late)[10:] == [New(), New()]


def test_a_shot_that_only_the_camera_tells_is_not_given_to_a_neighbour() -> None:
    learnt = [told(source, seq, 2.0 * seq + 0.1 * source) for seq in range(5) for source in (FEEDBACK, CAMERA)]
    assert verdicts(*learnt, told(FEEDBACK, 5, 10.0), told(CAMERA, 6, 10.7))[10:] == [New(), New()]


def test_a_camera_that_misses_a_shot_is_followed_again_after_four() -> None:
    events = [told(FEEDBACK, seq, 2.0 * seq) for seq in range(12)]
    events += [told(CAMERA, seq if seq < 4 else seq - 1, 2.0 * seq + 0.3) for seq in range(12) if seq != 4]
    events.sort(key=lambda event: event.received)
    merger = ShotMerger()
    outcome = {event.received: merger.add(round(event.received * 10), event) for event in events}
    assert [outcome[2.0 * seq + 0.3] for seq in range(8, 12)] == [Better(20 * seq) for seq in range(8, 12)]


def test_a_camera_that_takes_a_picture_by_itself_is_followed_again() -> None:
    merger, answers = ShotMerger(), dict[int, Verdict]()
    for shot in range(12):
        merger.add(shot, told(FEEDBACK, shot, 2.0 * shot))
        if shot == 5:
            merger.add(1000, told(CAMERA, 5, 2.0 * shot - 0.9))
        answers[shot] = merger.add(100 + shot, told(CAMERA, shot + (shot >= 5), 2.0 * shot + 0.3))
    assert [answers[shot] for shot in range(9, 12)] == [Better(9), Better(10), Better(11)]


@given(st.lists(st.sampled_from(list(Source)), min_size=1, max_size=4, unique=True), st.data())
def test_a_flight_with_losses_and_repetitions_has_the_right_number_of_shots(
    sources: list[Source], data: st.DataObject
) -> None:
    told_of, events = set[int](), list[TriggerEvent]()
    for shot in range(data.draw(st.integers(1, 10))):
        for source in sources:
            copies = data.draw(st.integers(0, 2))
            told_of |= {shot} if copies else set()
            event = told(source, shot + 100 * source, 2.0 * shot + 0.1 * source, 50.0 + 2.0 * shot)
            events += [replace(event, received=event.received + 0.1 * copy) for copy in range(copies)]
    answers = verdicts(*sorted(events, key=lambda event: event.received))
    assert sum(isinstance(answer, New) for answer in answers) == len(told_of)


def test_a_forger_with_many_cameras_is_not_remembered_for_ever() -> None:
    merger = ShotMerger()
    for index in range(2_000):
        merger.add(
            index, replace(told(Source(1 + index % 4), index, 0.001 * index), component=index % 250, camera=index % 7)
        )
    assert len(merger._seen) <= 32
    assert len(merger._counters._votes) <= 32 * 32


def test_what_a_flood_tells_takes_no_message_of_a_source_that_has_proved_true() -> None:
    """A hundred forged shots a second, in the aircraft's name; the aircraft's autopilot tells one each second."""
    forged = [replace(told(CAMERA, 7 * n, 10.0 + 0.01 * n), component=150) for n in range(500)]
    real = [told(FEEDBACK, n, 10.505 + n) for n in range(4)]
    merger, credible = ShotMerger(), frozenset([real[0].teller])
    events = sorted([*forged, *real], key=lambda event: event.received)
    answers = {event: merger.add(number, event, credible) for number, event in enumerate(events)}
    assert [answers[event] for event in real] == [New()] * 4


def test_a_source_that_has_proved_true_joins_a_shot_that_another_one_told_first() -> None:
    first, second = told(FEEDBACK, 1, 10.0), told(CAMERA, 77, 10.3)
    merger = ShotMerger()
    assert merger.add(0, first) == New()
    assert merger.add(1, second, frozenset([second.teller])) == Better(0)


def test_four_messages_over_two_links_are_one_shot_even_where_a_counter_wraps_or_begins_anew() -> None:
    """PX4's 112 and 263, ArduPilot's 180 (16 bits) and the camera's own 263, each twice; the vehicle boots in between."""
    merger, verdicts_of, dice = ShotMerger(), dict[int, list[tuple[int, Verdict]]](), random.Random(4)
    heard = []
    for shot in range(40):
        booted, count = (0.0, 65520 + shot) if shot < 25 else (50.0, shot - 25)
        boot_ms = round(1000 * (300 + 2 * shot - booted))
        messages = [
            (trigger(count, 1000 * boot_ms), 1),
            (captured(count, time_boot_ms=boot_ms, camera_id=1, capture_result=-1), 1),
            (feedback(count % 65536, time_usec=1000 * boot_ms), 1),
            (captured(7000 + shot, time_boot_ms=boot_ms, file_url=b"x/%d.jpg" % shot), 100),
        ]
        for message, component in messages:
            for link in range(2):
                event = decode(received(message, component=component), 2.0 * shot + 0.3 * dice.random() + 0.1 * link)
                assert event is not None
                heard.append((event.received, shot, event))
    for event_id, (_, shot, event) in enumerate(sorted(heard, key=lambda item: item[0])):
        verdicts_of.setdefault(shot, []).append((event_id, merger.add(event_id, event)))
    for shot, told_of in verdicts_of.items():
        (first, verdict), *others = told_of
        assert (shot, verdict) == (shot, New())
        assert {getattr(other, "of", None) for _, other in others} == {first}
        assert len(told_of) == 8


@pytest.mark.parametrize(("value", "result"), [(0, CaptureResult.FAILED), (-1, CaptureResult.UNKNOWN)])
def test_what_the_better_witness_says_of_a_shot_is_kept(value: int, result: CaptureResult) -> None:
    merger = ShotMerger()
    first = decode(received(trigger(1, 5_000_000)), 1.0)
    second = decode(received(captured(1, time_boot_ms=5000, capture_result=value), component=100), 1.1)
    assert first is not None
    assert second is not None
    assert (merger.add(0, first), merger.add(1, second), second.result) == (New(), Better(0), result)
