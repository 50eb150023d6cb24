"""Looks at one place, however their frames lie, show it in one orientation, scale and middle."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from gcs_mosaic.stitch.camera.geometry import Pose
from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.records import FrameState
from gcs_mosaic.views.coverage import Grid
from gcs_mosaic.views.flight_view import FlightView
from gcs_mosaic.views.ground_window import UNSEEN, aligned_look
from gcs_mosaic.views.pictures import NoPicture
from tests.views.drawn_flight import LENS, Drawn, drawn_flight, ground, laid_at

PLACE = (250.0, 260.0)
POSES = [
    Pose(250.0, 250.0),
    Pose(290.0, 240.0, yaw=math.radians(90)),
    Pose(240.0, 300.0, log_gsd=math.log(0.7), yaw=math.radians(200)),
    Pose(250.0, 250.0, log_gsd=math.log(1.3), pitch=0.1),
]


@pytest.fixture
def view(tmp_path: Path) -> FlightView:
    mark = laid_at(*PLACE, half=3)
    frames = [Drawn(f"{number}.png", pose, things=mark) for number, pose in enumerate(POSES)]
    return FlightView(drawn_flight(tmp_path / "flight", frames))


@pytest.mark.long
def test_all_show_the_same(view: FlightView) -> None:
    window = Grid.about(*PLACE, side=80.0, cells=160)
    looks = [aligned_look(view, number, 0, window).astype(float)[..., 0] for number in range(1, 5)]
    for look in looks:
        assert look[77:83, 77:83].min() > 200  # what was clicked is in the middle
        assert np.corrcoef(look.ravel(), looks[0].ravel())[0, 1] > 0.9
    truth = ground()[420:500, 410:490, 0].astype(float)  # north up: as the canvas lies
    assert np.corrcoef(looks[1][::2, ::2].ravel(), truth.ravel())[0, 1] > 0.5


def test_what_a_frame_does_not_see_is_grey(view: FlightView) -> None:
    window = Grid.about(250.0 + LENS.width / 2, 250.0, side=80.0, cells=80)
    look = aligned_look(view, 1, 0, window)
    assert (look[:, 50:] == UNSEEN).all()
    assert (look[10:70, 5:30] != UNSEEN).any(axis=2).mean() > 0.9


def test_a_covered_frame_is_laid_by_its_keyframe(tmp_path: Path) -> None:
    mark = laid_at(*PLACE, half=3)
    root = drawn_flight(
        tmp_path / "flight", [Drawn("key.png", POSES[0], things=mark), Drawn("b.png", POSES[0], things=mark)]
    )
    window = Grid.about(*PLACE, side=60.0, cells=60)
    with Ledger(root / LEDGER_NAME) as ledger:
        ledger.record_covered("b.png", "key.png", ((1.0, 0.0, 12.0), (0.0, 1.0, -7.0), (0.0, 0.0, 1.0)))
        ledger.settle_frame("b.png", FrameState.COVERED)
    look = aligned_look(FlightView(root), 2, 0, window)[..., 0].astype(float)
    key = aligned_look(FlightView(root), 1, 0, window)[..., 0].astype(float)
    # The pixel that was at (x, y) of the keyframe is sought at (x - 12, y + 7) of a frame with the same picture.
    assert np.corrcoef(look[:-8, 13:].ravel(), key[7:-1, 1:-12].ravel())[0, 1] > 0.9


def test_why_there_is_no_look_is_said(view: FlightView) -> None:
    window = Grid.about(*PLACE, side=80.0, cells=80)
    for number, island, at, why in (
        (99, 0, window, "does not lie there"),
        (1, 7, window, "does not lie there"),
        (1, 0, Grid.about(5000.0, 0.0, 80.0, 80), "does not see that place"),
    ):
        with pytest.raises(NoPicture, match=why):
            aligned_look(view, number, island, at)
