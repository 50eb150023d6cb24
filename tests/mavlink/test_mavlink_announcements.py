from __future__ import annotations

import itertools
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from gcs_mosaic.mavlink.announcements import Announcement, Announcer, heartbeat, status_text
from gcs_mosaic.mavlink.parser import dialect
from tests.mavlink.mavlink_peer import received


def sent(announcer: Announcer, now: float) -> list[Any]:
    return [received(message, system=191, component=191) for message in announcer.due(now)]


def texts(announcer: Announcer, now: float) -> list[str]:
    return [message.text for message in sent(announcer, now) if message.get_type() == "STATUSTEXT"]


def test_a_heartbeat_goes_out_once_a_second_and_claims_nothing() -> None:
    ours = Announcer()
    beats = [moment / 20 for moment in range(200) if sent(ours, moment / 20)]
    assert len(beats) == 10
    beat = received(heartbeat(), system=191, component=191)
    assert beat.type == dialect.MAV_TYPE_ONBOARD_CONTROLLER
    assert beat.autopilot == dialect.MAV_AUTOPILOT_INVALID
    assert (beat.base_mode, beat.custom_mode) == (0, 0)


def test_what_is_told_is_said_once() -> None:
    ours = Announcer()
    ours.tell(Announcement("overlap", "lost"))
    assert [text for now in range(60) for text in texts(ours, float(now))] == ["lost"]


def test_words_wait_until_somebody_can_be_reached() -> None:
    ours = Announcer()
    ours.tell(Announcement("overlap", "lost"))
    assert [message.get_type() for message in ours.due(1.0, reachable=False)] == ["HEARTBEAT"]
    assert texts(ours, 1.1) == ["lost"]


def test_of_one_topic_only_the_newest_word_is_said() -> None:
    ours = Announcer()
    for shot in range(500):
        ours.tell(Announcement("frames", f"{shot + 1} shots"))
    assert texts(ours, 1.0) == ["500 shots"]


def test_another_topic_does_not_wait_for_the_first_one() -> None:
    ours = Announcer()
    for now in range(30):
        ours.tell(Announcement("frames", "again"))
        if now == 5:
            ours.tell(Announcement("disk", "full"))
        if "full" in texts(ours, float(now)):
            break
    assert now <= 7


@given(st.lists(st.tuples(st.floats(0, 3), st.sampled_from(["overlap", "frames", "disk"])), max_size=200))
def test_however_much_is_told_little_is_said(told: list[tuple[float, Any]]) -> None:
    ours, now, said = Announcer(), 0.0, list[tuple[float, str]]()
    for wait, topic in told:
        now += wait
        ours.tell(Announcement(topic, topic))
        said += [(now, text) for text in texts(ours, now)]
    assert all(later >= before + 2.0 for (before, _), (later, _) in itertools.pairwise(said))
    for topic in ("overlap", "frames", "disk"):
        moments = [moment for moment, text in said if text == topic]
        assert all(later >= before + 10.0 for before, later in itertools.pairwise(moments))


def test_a_text_fits_into_its_message_whatever_it_holds() -> None:
    text = received(status_text(Announcement("frames", "ü" * 10 + "x" * 90, warning=False))).text
    assert text == "?" * 10 + "x" * 40
