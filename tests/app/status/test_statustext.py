from __future__ import annotations

from typing import Any

import pytest

from gcs_mosaic.app.status.statustext import Announcements
from gcs_mosaic.mavlink.announcements import Announcement
from gcs_mosaic.messages import Notice, Topic
from gcs_mosaic.store.records import FrameState
from gcs_mosaic.triggers import Missing
from tests.factories import trigger_event

PLACED, WAITING, REJECTED, DAMAGED = FrameState.PLACED, FrameState.WAITING, FrameState.REJECTED, FrameState.DAMAGED


class Ear:
    """Stands for a link's speaker."""

    def __init__(self) -> None:
        self.heard: list[Announcement] = []
        self.tell = self.heard.append

    @property
    def texts(self) -> list[str]:
        return [announcement.text.removeprefix("Mosaic: ") for announcement in self.heard]


@pytest.fixture
def ear() -> Ear:
    return Ear()


@pytest.fixture
def announcements(ear: Any) -> Announcements:
    return Announcements([ear])


def missing(sequence: int | None) -> Missing:
    return Missing(1, trigger_event(sequence))


def test_overlap_that_is_lost_and_comes_back_is_told_once_each(announcements: Announcements, ear: Ear) -> None:
    for state in (WAITING, PLACED, PLACED, WAITING, WAITING, REJECTED, DAMAGED, PLACED, PLACED):
        announcements.frame(state)
    assert ear.texts == ["overlap lost, frames match nothing", "overlap is back"]
    assert [announcement.warning for announcement in ear.heard] == [True, False]


def test_an_aircraft_that_leaves_the_map_is_told_while_another_stays_on_it(
    announcements: Announcements, ear: Ear
) -> None:
    for _ in range(3):
        for vehicle, state in ((1, PLACED), (2, PLACED)):
            announcements.frame(state, vehicle)
    for _ in range(3):
        for vehicle, state in ((1, PLACED), (2, WAITING)):
            announcements.frame(state, vehicle)
    announcements.frame(PLACED, 2)
    assert ear.texts == ["aircraft 2: overlap lost", "aircraft 2: overlap is back"]
    assert ear.heard[0].topic not in ("overlap", "overlap aircraft 1: "), "what another does replaces it not"


def test_shots_without_frame_are_counted(announcements: Announcements, ear: Ear) -> None:
    announcements.missing([missing(7), missing(9)])
    announcements.missing([])
    announcements.missing([missing(None)])
    assert ear.texts == ["1 shot without frame, last: 7", "2 shots without frame, last: 9", "3 shots without frame"]


@pytest.mark.parametrize(
    ("topic", "level", "text"),
    [
        (Topic.DISK, "warning", ["the disk is filling up"]),
        (Topic.DISK, "error", ["the disk cannot be written"]),
        (Topic.DISK, "info", []),
        (None, "warning", []),
    ],
)
def test_of_notices_only_those_about_the_disk_are_passed_on(
    announcements: Announcements, ear: Ear, topic: Topic | None, level: Any, text: list[str]
) -> None:
    announcements.notice(Notice(source="", level=level, text="…", topic=topic))
    assert ear.texts == text


def test_every_text_fits_into_one_message(announcements: Announcements, ear: Ear) -> None:
    announcements.missing([missing(2**32 - 1)])
    for state in (PLACED, WAITING, PLACED):
        announcements.frame(state)
    for level in ("warning", "error"):
        announcements.notice(Notice(source="disk", level=level, text="", topic=Topic.DISK))
    assert all(len(announcement.text) <= 50 for announcement in ear.heard)
    assert len(ear.heard) == 5
