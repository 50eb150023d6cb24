from __future__ import annotations

from dataclasses import replace

import pytest

from gcs_mosaic.frames.rtsp.clock import CaptureClock
from gcs_mosaic.frames.rtsp.frame_selection import Ask, Pick, Picker, Unanswered
from gcs_mosaic.frames.rtsp.ring_buffer import StreamPicture
from gcs_mosaic.frames.rtsp.settings import StreamSettings
from tests.factories import trigger_event
from tests.frames.rtsp.pictures import picture

SETTINGS = StreamSettings()


def decided(pictures: list[StreamPicture], *moments: float, now: float = 1000.0) -> list[Pick | Unanswered]:
    picker = Picker(SETTINGS)
    for moment in moments:
        picker.ask(Ask(moment, trigger_event()), now=min(moment, now))
    return picker.due(pictures, now)


def taken(pictures: list[StreamPicture], *moments: float) -> list[float | str]:
    found = decided(pictures, *moments)
    return [round(one.moment, 3) if isinstance(one, Pick) else one.reason for one in found]


def row(start: float = 10.0, end: float = 12.0, *, blur: bool = False, damaged: bool = False) -> list[StreamPicture]:
    return [picture(start + k / 10, blur=blur, damaged=damaged) for k in range(round((end - start) * 10))]


@pytest.mark.parametrize(("moment", "nearest"), [(11.04, 11.0), (11.06, 11.1), (10.0, 10.0), (9.96, 10.0)])
def test_the_nearest_picture_is_taken(moment: float, nearest: float) -> None:
    assert taken(row(), moment) == [nearest]


def test_a_blurred_picture_gives_way_to_a_sharp_one_in_the_window() -> None:
    pictures = row()
    pictures[10] = picture(11.0, blur=True)
    assert taken(pictures, 11.02) == [11.1]


def test_blurred_is_better_than_another_time() -> None:
    assert taken(row(blur=True), 11.02) == [11.0]


def test_a_damaged_picture_is_never_taken() -> None:
    pictures = [*row(10.0, 10.6), *row(10.6, 11.2, damaged=True), *row(11.2, 12.0)]
    assert taken(pictures, 10.9) == [11.2]
    assert taken(row(damaged=True), 11.0) == ["only damaged pictures"]


def test_a_picture_is_one_frame_however_many_triggers_ask() -> None:
    assert taken(row(), 11.0, 11.01, 11.02) == [11.0, 11.1, 10.9]


def test_who_is_trusted_comes_first_and_may_have_what_another_has_taken() -> None:
    pictures, picker = row(), Picker(SETTINGS)
    for moment in (10.9, 10.99, 11.0):
        picker.ask(Ask(moment, trigger_event()), now=moment)
    picker.ask(Ask(11.01, trigger_event(), is_trusted=True), now=11.01)
    first, *others = picker.due(pictures, 1000.0)
    assert isinstance(first, Pick)
    assert (first.ask.is_trusted, round(first.moment, 2)) == (True, 11.0)
    assert all(isinstance(one, Pick) and one.picture is not first.picture for one in others)
    for moment in (10.5, 10.51):
        picker.ask(Ask(moment, trigger_event(), is_trusted=moment > 10.5), now=moment)
        picker.due(pictures, 1000.0)
    picker.ask(Ask(10.5, trigger_event(), is_trusted=True), now=10.5)
    (again,) = picker.due(pictures, 1000.0)
    assert isinstance(again, Pick)
    assert round(again.moment, 2) != 10.5  # that one was for somebody trusted


def test_where_no_picture_is_near_none_is_taken() -> None:
    pictures = [*row(10.0, 11.0), *row(13.0, 14.0)]
    nearest = ", the nearest is 1.0 s from it (stream: farthest_s)"
    assert taken(pictures, 12.0) == [f"no picture of that time has come{nearest}"]
    assert taken([], 12.0) == ["no picture of that time has come"]
    assert taken(pictures, 11.3) == [10.9]


def test_of_a_stream_of_few_pictures_it_is_told_what_gives_each_trigger_one() -> None:
    pictures = [picture(moment) for moment in (10.0, 12.0, 14.0)]
    (told,) = taken(pictures, 13.0)
    assert str(told).endswith(
        "its pictures come 2.0 s apart; with stream: {farthest_s: 1.1} a trigger gets the nearest"
    )
    picker = Picker(replace(SETTINGS, farthest_s=1.1))
    picker.ask(Ask(13.0), now=13.0)
    assert isinstance(picker.due(pictures, 1000.0)[0], Pick)
    assert taken(pictures, 13.6) == [14.0]


def test_a_trigger_waits_for_the_pictures_after_it() -> None:
    picker = Picker(SETTINGS)
    picker.ask(Ask(11.95), now=12.0)
    assert picker.due(row(10.0, 12.0), now=12.1) == []
    (pick,) = picker.due(row(10.0, 12.3), now=12.4)
    assert isinstance(pick, Pick)
    assert pick.moment == pytest.approx(11.9)
    assert len(picker) == 0


def test_a_trigger_does_not_wait_for_ever() -> None:
    picker = Picker(SETTINGS)
    picker.ask(Ask(20.0), now=20.0)
    assert picker.due(row(10.0, 12.0), now=20.0 + SETTINGS.patience_s - 0.1) == []
    assert isinstance(picker.due(row(10.0, 12.0), now=20.0 + SETTINGS.patience_s)[0], Unanswered)


def test_times_that_are_not_settled_decide_nothing() -> None:
    clock = CaptureClock(11.9, 0.0)
    clock.note(0.0, 12.0, 0.0)
    picker = Picker(SETTINGS)
    picker.ask(Ask(11.5), now=12.0)
    assert picker.due([picture(0.0, clock=clock)], now=12.1) == []
