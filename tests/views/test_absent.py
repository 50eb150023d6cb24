"""Shots that are not on the map are told where they should be."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from gcs_mosaic.messages import OtherFile
from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.stitch.camera.geometry import Camera, Pose
from gcs_mosaic.store.documents import write_json
from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.records import EventState, FlightRecord, FrameState
from gcs_mosaic.views import absent
from gcs_mosaic.views.absent import NO_PICTURE, NOTHING_YET, absent_shots
from gcs_mosaic.views.flight_view import FlightView
from tests.factories import frame, trigger_event

CAMERA = Camera(240, 180, focal=1.3)


@pytest.fixture
def ledger(tmp_path: Path) -> Iterator[Ledger]:
    write_json(tmp_path / "mosaic.json", {"revision": 1})
    with Ledger(tmp_path / LEDGER_NAME) as opened:
        opened.begin_flight(FlightRecord(name="small", started_utc=1.0))
        opened.record_island(0)
        opened.record_island(1)
        yield opened


def shot(
    ledger: Ledger,
    number: int,
    state: FrameState | None,
    *,
    heard: bool = True,
    island: int = 0,
    at_s: float | None = None,
) -> None:
    """One of a lane of shots each 2 s and 100 units; without a state its picture never came."""
    name, time = f"{number}.jpg", 1000.0 + 2 * number if at_s is None else at_s
    event = ledger.record_event(trigger_event(number, time)) if heard else None
    if state is None:
        assert event is not None
        ledger.settle_event(event, EventState.MISSING)
        return
    ledger.record_frame(frame(name, modified=1.7e9 + time))
    if event is not None:
        ledger.settle_event(event, EventState.MATCHED, frame=name)
    ledger.settle_frame(name, state, "too dark" if state is FrameState.REJECTED else None)
    if state is FrameState.PLACED:
        pose = Pose(100.0 * number, 50.0)
        ledger.record_painted(RenderItem(name=name, order=number, island=island, pose=pose, camera=CAMERA, level=16))


def test_a_shot_lies_between_those_before_and_after_it(ledger: Ledger, tmp_path: Path) -> None:
    states = [FrameState.PLACED, None, FrameState.PLACED, FrameState.REJECTED, FrameState.WAITING, FrameState.PLACED]
    for number, state in enumerate(states):
        shot(ledger, number, state)
    shots = absent_shots(FlightView(tmp_path))
    assert [(one.name, one.state, one.reason, one.island) for one in shots] == [
        ("3.jpg", "rejected", "too dark", 0),
        ("4.jpg", "waiting", NOTHING_YET, 0),
        ("", "missing", NO_PICTURE, 0),
    ]
    assert [one.place for one in shots] == [pytest.approx((x, 50.0)) for x in (300.0, 400.0, 100.0)]


def test_without_events_the_times_of_files_tell(ledger: Ledger, tmp_path: Path) -> None:
    for number, state in enumerate([FrameState.PLACED, FrameState.REJECTED, FrameState.PLACED]):
        shot(ledger, number, state, heard=False)
    (one,) = absent_shots(FlightView(tmp_path))
    assert one.place == pytest.approx((100.0, 50.0))


def test_where_nothing_is_known_no_place_is_told(ledger: Ledger, tmp_path: Path) -> None:
    shot(ledger, 0, None)  # before the first
    shot(ledger, 1, FrameState.PLACED)
    shot(ledger, 2, None)  # between two islands
    shot(ledger, 3, FrameState.PLACED, island=1)
    shot(ledger, 4, FrameState.PLACED, island=1)
    shot(ledger, 5, None, at_s=1100.0)  # in a long pause
    shot(ledger, 6, FrameState.PLACED, island=1, at_s=1200.0)
    shot(ledger, 7, None, at_s=1300.0)  # after the last
    assert [(one.island, one.place) for one in absent_shots(FlightView(tmp_path))] == [(None, None)] * 4


def test_shots_that_somebody_forged_push_no_frame_off_the_list(
    ledger: Ledger, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(absent, "MOST", 3)
    for number, state in enumerate([FrameState.REJECTED, *[None] * 9]):
        shot(ledger, number, state)
    assert [one.state for one in absent_shots(FlightView(tmp_path))] == ["rejected", *["missing"] * 3]


def test_shots_of_a_camera_that_is_left_out_are_not_absent(ledger: Ledger, tmp_path: Path) -> None:
    """Where each of several cameras tells its own file of each shot: one of them is mapped."""
    for number, hint in enumerate(("a_W.jpg", "100MEDIA/A_T.JPG", "b_T.jpg")):
        event = ledger.record_event(trigger_event(number, 1000.0, file_hint=hint))
        ledger.settle_event(event, EventState.MISSING)
    assert ledger.shots_of_other_cameras() == frozenset()
    ledger.record_other(OtherFile(frame=frame("card/100MEDIA/a_t.jpg"), camera="_t", mapped="_w"))
    assert ledger.shots_of_other_cameras() == {2}
    assert [one.name for one in absent_shots(FlightView(tmp_path))] == ["a_W.jpg", "b_T.jpg"]
