"""When frames were taken, as people are told."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from gcs_mosaic.messages import content_hash
from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.stitch.camera.geometry import Camera, Pose
from gcs_mosaic.store.documents import write_json
from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.records import EventState
from gcs_mosaic.views.flight_view import FlightView
from gcs_mosaic.views.sightings import sightings
from gcs_mosaic.views.taken import CaptureTime
from tests.factories import frame, trigger_event
from tests.frames.image_files import encoded, photographed, picture, with_exif

CAMERA = Camera(240, 180, focal=1.3)
BY_CAMERA = 1413724857.0  # 2014-10-19 13:20:57, as if the clock showed UTC
COPIED = 1.79e9  # the files' own time
TOLD = 1.7e9


def flight_of(root: Path, dates: Sequence[str | None], *, told: bool) -> FlightView:
    """Frames that lie on each other; the date that each camera wrote, and whether messages tell when they were taken."""
    (root / "frames").mkdir()
    with Ledger(root / LEDGER_NAME) as ledger:
        ledger.record_island(0)
        for k, date in enumerate(dates):
            jpeg = encoded(".jpg", picture(240, 180))
            data = jpeg if date is None else with_exif(jpeg, photographed(date.encode()))
            (root / "frames" / f"{k}.jpg").write_bytes(data)
            ledger.record_frame(frame(f"{k}.jpg", content_hash=content_hash(data + bytes([k])), modified=COPIED + k))
            ledger.record_original(f"{k}.jpg", f"frames/{k}.jpg")
            ledger.record_painted(
                RenderItem(name=f"{k}.jpg", order=k, island=0, pose=Pose(0, 0), camera=CAMERA, level=16)
            )
            if told:
                event = ledger.record_event(trigger_event(k, utc=TOLD + k))
                ledger.settle_event(event, EventState.MATCHED, frame=f"{k}.jpg")
    write_json(root / "mosaic.json", {"revision": 1})
    return FlightView(root)


def test_the_camera_tells_before_a_message_and_that_before_the_file(tmp_path: Path) -> None:
    cases = {"camera": ("2014:10:19 13:20:57", True), "message": (None, True), "file": (None, False)}
    found = {}
    for clock, (date, told) in cases.items():
        (tmp_path / clock).mkdir()
        (one,) = sightings(flight_of(tmp_path / clock, [date], told=told), 0, 0.0, 0.0)
        found[clock] = one.clock, one.utc
    assert found == {"camera": ("camera", BY_CAMERA), "message": ("message", TOLD), "file": ("file", COPIED)}


def test_times_are_compared_by_one_clock_that_has_them_all(tmp_path: Path) -> None:
    """A camera's clock is off by its zone, at least."""
    date = "2014:10:19 13:20:57"
    for name, dates, told, expected in (
        ("cameras", [date, date], True, [BY_CAMERA, BY_CAMERA]),
        ("messages", [date, None], True, [TOLD, TOLD + 1]),
        ("files", [date, None], False, [COPIED, COPIED + 1]),
    ):
        (tmp_path / name).mkdir()
        view = flight_of(tmp_path / name, dates, told=told)
        assert np.array_equal(view.taken(view.table()), expected), name


def test_an_original_that_has_gone_tells_nothing(tmp_path: Path) -> None:
    view = flight_of(tmp_path, ["2014:10:19 13:20:57"], told=False)
    (tmp_path / "frames" / "0.jpg").unlink()
    (one,) = sightings(view, 0, 0.0, 0.0)
    assert (one.clock, one.utc) == ("file", COPIED)


def test_a_time_is_told_with_its_clock() -> None:
    said = [CaptureTime(BY_CAMERA, by).words() for by in ("camera", "message", "file")]
    assert said == [
        "taken 2014-10-19T13:20:57 by the camera's clock",
        "taken 2014-10-19T13:20:57Z",
        "came 2014-10-19T13:20:57Z by its file",
    ]


def test_exports_tell_when_pictures_were_taken(tmp_path: Path) -> None:
    """Not when their files were copied."""
    view = flight_of(tmp_path, ["2014:10:19 13:20:57", None], told=False)
    times = view.capture_times(view.table())
    assert [times[number].iso("seconds") for number in (1, 2)] == ["2014-10-19T13:20:57", "2026-09-21T14:13:21Z"]
    assert view.capture_time(1) == times[1]
    assert view.capture_time(99) is None
