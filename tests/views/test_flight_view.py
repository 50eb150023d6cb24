"""Painted frames as they lie, read beside the flight."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.stitch.camera.geometry import Camera, Pose
from gcs_mosaic.stitch.camera.relief import ReliefDisplacement
from gcs_mosaic.store.documents import write_json
from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.views import flight_view
from gcs_mosaic.views.flight_view import FlightView, pixels_of, places_of
from tests.factories import frame
from tests.sure import sure

LENS = Camera(400, 300, focal=1.4, k1=-0.1)
BUMPS = ReliefDisplacement.from_grid(np.random.default_rng(1).normal(0, 0.004, (13, 17, 2)))


def painted(name: str, x: float, island: int = 0) -> RenderItem:
    pose = Pose(x, 0.0, yaw=0.3, pitch=0.1)
    return RenderItem(name=name, order=0, island=island, pose=pose, camera=LENS, relief=BUMPS, level=16)


@pytest.fixture
def root(tmp_path: Path) -> Path:
    with Ledger(tmp_path / LEDGER_NAME) as ledger:
        ledger.record_island(0)
        ledger.record_island(1)
        for name, x, island in (("a.jpg", 0.0, 0), ("b.jpg", 1000.0, 0), ("c.jpg", 0.0, 1)):
            ledger.record_frame(frame(name))
            ledger.record_painted(painted(name, x, island))
    write_json(tmp_path / "mosaic.json", {"revision": 1})
    return tmp_path


def test_frames_are_found_by_place_and_island(root: Path) -> None:
    table = FlightView(root).table()
    assert [one.name for one in table.frames] == ["a.jpg", "b.jpg", "c.jpg"]
    assert table.near(0, (-10, -10, 10, 10)) == [0]
    assert table.near(1, (-10, -10, 10, 10)) == [2]
    assert table.near(0, (-10, -10, 1010, 10)) == [0, 1]


def test_pixels_and_places_are_inverse_with_lens_and_relief(root: Path) -> None:
    view = FlightView(root)
    one = sure(view.painted(view.table().frames[1].number))
    pixels = np.array([[0.0, 0.0], [399.0, 299.0], [123.0, 45.0]])
    assert one.relief == BUMPS
    assert np.abs(pixels_of(one, places_of(one, pixels)) - pixels).max() < 0.02


def test_what_was_painted_since_is_seen(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(flight_view, "LEAST_REST_S", 0.0)
    monkeypatch.setattr(flight_view, "REST", 0.0)
    view = FlightView(root)
    assert len(view.table().frames) == 3
    with Ledger(root / LEDGER_NAME) as ledger:
        ledger.record_painted(painted("a.jpg", 5000.0))
    assert view.table().near(0, (4990, -10, 5010, 10)) == []  # documents tell when there is something new
    write_json(root / "mosaic.json", {"revision": 2})
    assert view.table().near(0, (4990, -10, 5010, 10)) == [0]
    assert sure(view.painted(1)).pose.x == 5000.0


def test_a_folder_without_a_flight_has_no_frames(tmp_path: Path) -> None:
    assert FlightView(tmp_path).table().frames == []


def test_a_look_that_took_long_does_not_make_the_next_ones_old(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """On a busy machine reading is mostly waiting: a first look of 40 s made clicks blind for a quarter of an hour."""
    read = Ledger.positions

    def slowly(ledger: Ledger, *given: Any) -> list[Any]:
        time.sleep(0.3)
        return read(ledger, *given)

    monkeypatch.setattr(Ledger, "positions", slowly)
    view = FlightView(root)
    assert view.table().revision == 1
    write_json(root / "mosaic.json", {"revision": 2})
    time.sleep(flight_view.MOST_REST_S)
    assert view.table().revision == 2


def test_only_what_has_changed_is_made_anew(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(flight_view, "MOST_REST_S", 0.0)
    view = FlightView(root)
    before = view.table()
    with Ledger(root / LEDGER_NAME) as ledger:
        ledger.record_painted(painted("b.jpg", 7000.0))
    write_json(root / "mosaic.json", {"revision": 2})
    after = view.table()
    assert [one is other for one, other in zip(before.frames, after.frames, strict=True)] == [True, False, True]
    fresh = FlightView(root).table()
    assert np.array_equal(after.outlines, fresh.outlines)
    assert np.array_equal(after.boxes, fresh.boxes)
    assert list(after.frames) == list(fresh.frames)
