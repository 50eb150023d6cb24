"""Senders whose numbers and times are none: a public camera simulator writes index 1 and no time for every picture, others
write index -1, or seconds into the milliseconds since boot. Eight shots, one each five seconds."""

from __future__ import annotations

import random
from collections.abc import Callable
from typing import Any

import pytest

from gcs_mosaic.mavlink.messages import decode
from gcs_mosaic.messages import Notice, TriggerEvent
from gcs_mosaic.triggers.shots import CameraMessage, Duplicate, New, Shots, ShotSettings
from tests.factories import trigger_event
from tests.mavlink.mavlink_peer import captured, received

Fields = Callable[[int], dict[str, Any]]
COUNT, EVERY_S = 8, 5.0


def told(
    fields: Fields, *, every: float = EVERY_S, jitter: float = 0.0, copies: int = 1
) -> list[CameraMessage | Notice]:
    """What is made of the camera's messages about eight shots; copies come 0.2 s apart."""
    dice, events = random.Random(7), list[TriggerEvent]()
    for shot in range(COUNT):
        for copy in range(copies):
            message = received(captured(fields(shot).pop("index", 1), **_plain(fields(shot))), component=100)
            event = decode(message, 100.0 + every * shot + 0.2 * copy + jitter * dice.random())
            assert event is not None
            events.append(event)
    return list(Shots(ShotSettings()).follow(iter(events)))


def _plain(fields: dict[str, Any]) -> dict[str, Any]:
    return {"time_boot_ms": 0, "time_utc": 0, **{name: value for name, value in fields.items() if name != "index"}}


def moments(heard: list[CameraMessage | Notice]) -> list[float]:
    return [one.verdict.moment for one in heard if isinstance(one, CameraMessage) and isinstance(one.verdict, New)]


def said(heard: list[CameraMessage | Notice]) -> str:
    return "; ".join(one.text for one in heard if isinstance(one, Notice))


SENDERS: dict[str, tuple[Fields, str]] = {
    "always 1, no time": (lambda shot: {"index": 1}, "the number 1 every time"),
    "always 0, no time": (lambda shot: {"index": 0}, "the number 0 every time"),
    "always -1, no time": (lambda shot: {"index": -1}, "no number"),
    "always 1, the same time": (lambda shot: {"index": 1, "time_boot_ms": 1234}, "stands still"),
    "always 1, the same date": (lambda shot: {"index": 1, "time_utc": 1_700_000_000_000_000}, "stands still"),
    "always 1, the same name": (lambda shot: {"index": 1, "file_url": b"image.jpg"}, "the number 1 every time"),
    "always 1, each its name": (lambda shot: {"index": 1, "file_url": b"a%d.jpg" % shot}, "the number 1 every time"),
    "seconds for milliseconds": (lambda shot: {"index": -1, "time_boot_ms": 60 + 5 * shot}, "a clock that"),
    "microseconds for them": (lambda shot: {"index": -1, "time_boot_ms": 1_000_000 * (60 + 5 * shot)}, "a clock that"),
    "half as fast": (lambda shot: {"index": shot, "time_boot_ms": 60_000 + 2500 * shot}, "a clock that goes 0.5"),
    "jumps": (lambda shot: {"index": shot, "time_boot_ms": 900_000 * (shot % 3) + 5000 * shot + 1}, "a clock that"),
    "backwards": (lambda shot: {"index": shot, "time_boot_ms": 900_000 - 5000 * shot}, "a clock that"),
}


@pytest.mark.parametrize("sender", SENDERS)
@pytest.mark.parametrize("copies", [1, 2])
def test_each_shot_is_one_whatever_its_sender_counts_and_dates(sender: str, copies: int) -> None:
    fields, remark = SENDERS[sender]
    heard = told(fields, copies=copies)
    assert len(moments(heard)) == COUNT
    assert remark in said(heard)


@pytest.mark.parametrize("sender", [one for one in SENDERS if one not in ("half as fast", "jumps", "backwards")])
def test_shots_are_dated_by_their_messages_where_the_clock_is_none(sender: str) -> None:
    assert moments(told(SENDERS[sender][0])) == pytest.approx(
        [100.0 + EVERY_S * shot for shot in range(COUNT)], abs=0.5
    )


@pytest.mark.parametrize("sender", ["half as fast", "backwards"])
def test_a_clock_of_another_pace_is_found_out_within_a_few_shots(sender: str) -> None:
    late = [100.0 + EVERY_S * shot - at for shot, at in enumerate(moments(told(SENDERS[sender][0])))]
    assert max(late) < 25.0
    assert late[4:] == pytest.approx([0.0] * (COUNT - 4), abs=0.5)


def test_pictures_in_quick_succession_of_a_camera_that_cannot_count_are_all_counted() -> None:
    assert len(moments(told(lambda shot: {"index": 1}, every=1.2))) == COUNT


def test_nothing_is_said_of_a_camera_that_counts_and_dates_its_shots() -> None:
    heard = told(lambda shot: {"index": shot, "time_boot_ms": 60_000 + 5000 * shot}, jitter=2.5, copies=2)
    assert len(moments(heard)) == COUNT
    assert said(heard) == ""


def test_an_outage_of_the_link_says_nothing_about_the_clock() -> None:
    """What was held back comes at once, dated to when it happened."""
    shots = Shots(ShotSettings())
    came = [0.0, 2.0, 4.0, 6.0] + [60.0] * 27 + [62.0, 64.0]
    for shot, at in enumerate(came):
        event = decode(received(captured(shot, time_boot_ms=5000 + 2000 * shot, time_utc=0), component=100), at)
        assert event is not None
        verdict = shots.hear(event).verdict
        assert isinstance(verdict, New)
        assert verdict.moment == pytest.approx(2.0 * shot, abs=0.1)
        assert shots.news(event) == []


def test_what_is_asked_for_again_is_still_a_repetition() -> None:
    """A ground station asks for number 3 again, half a minute later; this camera tells no times."""
    shots, verdicts = Shots(ShotSettings()), []
    for index, at in [(1, 0.0), (2, 5.0), (3, 10.0), (4, 15.0), (3, 40.0)]:
        event = decode(received(captured(index, time_boot_ms=0, time_utc=0), component=100), at)
        assert event is not None
        verdicts.append(shots.hear(event).verdict)
    assert verdicts == [New(), New(), New(), New(), Duplicate(3)]


def test_forgers_are_remarked_upon_only_so_often() -> None:
    shots, texts = Shots(ShotSettings()), []
    for n in range(300):
        event = decode(received(captured(1, time_boot_ms=0, time_utc=0), component=2 + n % 20), 5.0 * n)
        assert event is not None
        shots.hear(event)
        texts += shots.news(event)
    assert 0 < len(texts) <= 8


@pytest.mark.parametrize("times", ["boot", "date", "both", "none"])
def test_a_counter_that_has_proved_itself_counts_on_while_its_last_shot_is_told_again_and_again(times: str) -> None:
    """A camera that sends its last message every two seconds until the next shot, as where a message interval was asked for."""
    shots, new = Shots(ShotSettings()), 0
    for shot in range(10):
        for copy in range(1 if shot < 4 else 8):
            boot = 60_000 + 20_000 * shot if times in ("boot", "both") else 0
            date = 1_700_000_000_000_000 + 20_000_000 * shot if times in ("date", "both") else 0
            event = decode(
                received(captured(shot, time_boot_ms=boot, time_utc=date), component=100), 100.0 + 20 * shot + 2 * copy
            )
            assert event is not None
            new += isinstance(shots.hear(event).verdict, New)
    assert new == 10


@pytest.mark.parametrize("later", [0.5, 5.0, 50.0])
def test_the_first_shot_of_all_that_is_told_again_is_one(later: float) -> None:
    """A ground station asks for the message again before the second shot."""
    shots, message = Shots(ShotSettings()), received(captured(0, time_boot_ms=60_000, time_utc=1_700_000_000_000_000))
    first, again = decode(message, 100.0), decode(message, 100.0 + later)
    assert first is not None
    assert again is not None
    assert isinstance(shots.hear(first).verdict, New)
    assert isinstance(shots.hear(again).verdict, Duplicate)


def test_two_cameras_of_one_sender_that_tell_of_one_moment_have_a_clock() -> None:
    """One trigger, two cameras: the second one's message comes when its file is written, more than a second later."""
    shots = Shots(ShotSettings())
    for shot in range(10):
        for camera, late in ((1, 0.3), (2, 1.9)):
            event = trigger_event(
                shot, 100 + 3.0 * shot + late, source_time=50 + 3.0 * shot, clock="boot", camera=camera, component=100
            )
            shots.hear(event)
            assert shots.news(event) == []


@pytest.mark.parametrize("share", [0.05, 0.1])
def test_a_queue_that_grows_is_no_fault_of_the_clock(share: float) -> None:
    """A slow radio falls behind, message by message."""
    shots = Shots(ShotSettings())
    for shot in range(10):
        at = 5.0 * shot
        event = trigger_event(shot, 100 + at + share * at, source_time=50 + at, clock="boot")
        verdict = shots.hear(event).verdict
        assert isinstance(verdict, New)
        assert verdict.moment == pytest.approx(100 + at, abs=0.5)
