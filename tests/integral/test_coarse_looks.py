"""What a lens keeps in memory does not grow with the ground that it is laid over."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from gcs_mosaic.integral.flight_looks import coarsened, looks_at, spread
from gcs_mosaic.integral.stack import GroundLook, GroundWindow, laid
from gcs_mosaic.stitch.camera.geometry import Camera, Pose
from gcs_mosaic.views.flight_view import FlightView
from tests.sure import sure
from tests.views.drawn_flight import Drawn, drawn_flight


@pytest.mark.long
def test_looks_are_no_finer_than_the_window(tmp_path: Path) -> None:
    frames = [Drawn(f"{n}.png", Pose(150.0 + 20 * n, 250.0)) for n in range(3)]
    view = FlightView(drawn_flight(tmp_path / "flight", frames))
    for side in (3200.0, 1e6):  # a frame is seen by no more than 4 x 3 of the cells
        found = looks_at(view, 0, GroundWindow(180.0, 250.0, side, 32))
        assert len(found.looks) == 3
        assert all(one.image.shape[0] * one.image.shape[1] <= 12 for one in found.looks)


@pytest.mark.parametrize("bands", [1, 3])
def test_a_coarse_look_shows_everything_where_it_was(bands: int) -> None:
    """A ramp: where a look lay half a cell beside its place, each value would be another."""
    camera, window = Camera(320, 240, focal=1.4), GroundWindow(3.0, -5.0, 160.0, 32)
    columns, rows = np.meshgrid(np.arange(320), np.arange(240))
    ramp = np.repeat((columns + 0.5 * rows).astype(np.float32)[..., None], bands, axis=2)
    look = GroundLook("ramp", Pose(0.0, 0.0, yaw=0.4), camera, ramp)
    coarse = coarsened(look, window, 1.0)
    assert coarse.image.shape == (240 // 5, 320 // 5, bands)
    fine, kept = (sure(laid(one, window, 0.0)) for one in (look, coarse))
    known = np.isfinite(fine), np.isfinite(kept)
    assert known[0].any()
    assert (
        known[0] & ~known[1]
    ).sum() <= 2 * window.cells * bands  # the pixels of two rims, at the right and at the bottom
    assert not (known[1] & ~known[0]).any()
    assert np.nanmax(np.abs(cv2.absdiff(fine, kept))) < 0.1
    assert coarsened(look, window, 3.0) is look


@pytest.mark.parametrize(("count", "most"), [(17, 16), (31, 30), (100, 30), (5, 5), (3, 30), (60, 2)])
def test_as_many_looks_as_are_wanted_are_spread_over_all(count: int, most: int) -> None:
    kept = spread(range(count), most)
    assert len(kept) == min(count, most)
    assert (kept[0], kept[-1]) == (0, count - 1)
    steps = np.diff(kept)
    assert steps.max() - steps.min() <= 1
