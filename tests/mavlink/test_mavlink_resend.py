from __future__ import annotations

import itertools
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_mosaic.mavlink.messages import decode
from gcs_mosaic.mavlink.parser import dialect
from gcs_mosaic.mavlink.resend import Recovery
from gcs_mosaic.messages import CaptureResult, TriggerEvent
from tests.mavlink.mavlink_peer import captured, received, trigger

OWN = 191


def picture(index: int, time: float | None = None, component: int = 100, camera: int = 0) -> TriggerEvent:
    event = decode(received(captured(index, camera_id=camera), component=component), 0.0)
    assert event is not None
    return replace(event, source_time=10.0 + 2 * index if time is None else time)


def told(*indices: int, link: str = "a") -> Recovery:
    ours = Recovery()
    for index in indices:
        ours.note(picture(index), link, 0.0)
    return ours


def asked(ours: Recovery, until: float = 60.0, link: str = "a", begin: float = 0.0) -> list[tuple[float, int]]:
    """(when, for which index) of all questions, looked for four times a second."""
    moments = [begin + step / 4 for step in range(round(4 * (until - begin)))]
    questions = [(now, ours.due(link, now)) for now in moments]
    return [(now, round(received(question).param2)) for now, question in questions if question]


def ack(result: int, component: int = 100, **target: int) -> Any:
    message = dialect.MAVLink_command_ack_message(dialect.MAV_CMD_REQUEST_MESSAGE, result, **target)
    return received(message, component=component)


def test_a_message_that_was_lost_is_asked_for_three_times() -> None:
    assert asked(told(4, 5, 7)) == [(1.0, 6), (4.0, 6), (7.0, 6)]


def test_the_question_is_the_standards_and_goes_to_that_camera() -> None:
    question = received(told(4, 6).due("a", 5.0), system=OWN, component=191)
    assert (question.command, question.param1, question.param2) == (512, 263, 5)
    assert (question.target_system, question.target_component) == (1, 100)
    assert (question.param3, question.param4, question.param5, question.param6, question.param7) == (0, 0, 0, 0, 0)


def test_one_question_a_second_is_asked_however_much_was_lost() -> None:
    questions = asked(told(1, 60), until=300.0)
    assert len(questions) == 3 * 58
    assert all(later - before >= 1.0 for (before, _), (later, _) in itertools.pairwise(questions))
    assert {index: [other for _, other in questions].count(index) for index in range(2, 60)} == dict.fromkeys(
        range(2, 60), 3
    )


def test_what_comes_is_not_asked_for_again() -> None:
    ours = told(4, 7)
    assert asked(ours, until=2.5) == [(1.0, 5), (2.0, 6)]
    ours.note(picture(5), "a", 2.5)
    assert {index for _, index in asked(ours, begin=3.0)} == {6}


def test_a_message_that_was_only_late_is_not_asked_for() -> None:
    ours = told(4, 6)
    ours.note(picture(5), "a", 0.9)
    assert asked(ours) == []


def test_what_another_link_brings_is_not_asked_for() -> None:
    ours = told(4, 6)
    ours.note(picture(5), "b", 0.5)
    assert asked(ours) + asked(ours, link="b") == []


def test_a_camera_is_asked_where_it_is_heard_and_only_there() -> None:
    ours = told(4, 6, link="b")
    assert asked(ours) == []
    assert len(asked(ours, link="b")) == 3


def test_links_together_ask_once_a_second() -> None:
    ours = told(1, 20)
    ours.note(picture(20), "b", 0.0)
    questions = [(now, link) for now in range(40) for link in "ab" if ours.due(link, now / 4)]
    assert len(questions) <= 10


@pytest.mark.parametrize("result", [dialect.MAV_RESULT_DENIED, dialect.MAV_RESULT_UNSUPPORTED])
def test_a_camera_that_refuses_is_asked_no_more(result: int) -> None:
    ours = told(4, 9)
    assert ours.due("a", 1.0)
    assert ours.acknowledged(ack(result), OWN, 1.2)
    assert not ours.acknowledged(ack(result), OWN, 1.3)
    ours.note(picture(20), "a", 2.0)
    assert asked(ours, begin=2.0) == []


@pytest.mark.parametrize(
    "answer",
    [
        ack(dialect.MAV_RESULT_ACCEPTED),
        ack(dialect.MAV_RESULT_FAILED),
        ack(dialect.MAV_RESULT_DENIED, component=1),
        ack(dialect.MAV_RESULT_DENIED, target_system=255, target_component=190),
    ],
)
def test_other_answers_end_nothing(answer: Any) -> None:
    ours = told(4, 9)
    assert ours.due("a", 1.0)
    assert not ours.acknowledged(answer, OWN, 1.2)
    assert asked(ours, begin=2.0)


def test_a_refusal_of_what_we_never_asked_is_somebody_elses() -> None:
    ours = told(4, 5)
    assert not ours.acknowledged(ack(dialect.MAV_RESULT_DENIED), OWN, 1.0)
    ours.note(picture(8), "a", 2.0)
    assert asked(ours, begin=2.0)


def test_a_counter_that_begins_anew_leaves_no_gap() -> None:
    ours = told(40, 43)
    ours.note(picture(0, time=500.0), "a", 0.0)
    ours.note(picture(1, time=502.0), "a", 0.0)
    assert asked(ours) == []
    ours.note(picture(900, time=504.0), "a", 60.0)
    assert asked(ours, begin=60.0, until=90.0) == []


def test_a_repetition_is_no_new_beginning() -> None:
    ours = told(4, 5, 6, 4, 5, 8)
    assert {index for _, index in asked(ours)} == {7}


def test_a_failed_attempt_and_the_picture_after_it_may_have_one_index() -> None:
    ours = told(4, 6)
    ours.note(replace(picture(6, time=99.0), result=CaptureResult.FAILED), "a", 0.0)
    assert {index for _, index in asked(ours)} == {5}


def test_what_comes_after_the_last_question_is_no_new_beginning() -> None:
    ours = told(4, 6)
    assert len(asked(ours)) == 3
    ours.note(picture(5), "a", 60.0)
    ours.note(picture(8), "a", 61.0)
    assert {index for _, index in asked(ours, begin=61.0, until=90.0)} == {7}


def test_each_camera_counts_for_itself() -> None:
    ours = Recovery()
    for event in (picture(1), picture(5, component=101), picture(9, camera=2), picture(2), picture(6, component=101)):
        ours.note(event, "a", 0.0)
    assert asked(ours) == []


def test_only_image_captured_can_be_asked_for() -> None:
    ours = Recovery()
    for seq in (1, 5):
        event = decode(received(trigger(seq)), 0.0)
        assert event is not None
        ours.note(event, "a", 0.0)
    ours.note(picture(-1), "a", 0.0)
    assert asked(ours) == []


def test_an_index_that_no_float_can_name_is_not_asked_for() -> None:
    assert {index for _, index in asked(told(2**24 - 2, 2**24 + 5))} == {2**24 - 1}


@given(st.lists(st.tuples(st.integers(-1, 2**31 - 1) | st.integers(0, 90), st.floats(0, 4)), max_size=60))
def test_whatever_comes_questions_are_few_and_never_about_what_was_told_last(steps: list[tuple[int, float]]) -> None:
    ours, now, last = Recovery(), 0.0, -10.0
    for index, wait in steps:
        now += wait
        ours.note(picture(index, time=now), "a", now)
        question = ours.due("a", now)
        if question:
            assert now - last >= 1.0
            assert question.param2 != index
            last = now
    assert all(len(camera.lost) <= 256 and len(camera.heard) <= 256 for camera in ours._cameras.values())
