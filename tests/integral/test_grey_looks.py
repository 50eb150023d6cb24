"""Which looks are of one band: by the same rule as elsewhere, and by the whole picture, not by what a lens shows of it."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from gcs_mosaic.integral import flight_looks
from gcs_mosaic.integral.flight_looks import looks_at
from gcs_mosaic.integral.stack import GroundWindow
from gcs_mosaic.stitch.arrays import ImageBGR
from gcs_mosaic.stitch.camera.geometry import Pose
from gcs_mosaic.views.flight_view import FlightView
from tests.views.drawn_flight import LENS, Drawn, drawn_flight

WARM = np.random.default_rng(2).integers(40, 200, (LENS.height, LENS.width, 1), np.uint8).repeat(3, axis=2)
CROSSHAIR = cv2.drawMarker(WARM.copy(), (160, 120), (0, 0, 255), cv2.MARKER_CROSS, 30, 2).astype(np.uint8)
TARMAC = WARM.copy()
TARMAC[:, :60] = (40, 120, 60)  # a meadow beside it, which the lens does not see


@pytest.mark.long
@pytest.mark.parametrize(("picture", "bands"), [(CROSSHAIR, 1), (TARMAC, 3)])
def test_a_look_is_of_one_band_where_its_whole_picture_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, picture: ImageBGR, bands: int
) -> None:
    root = drawn_flight(tmp_path / "flight", [Drawn(f"{n}.png", Pose(150.0 + 4 * n, 250.0)) for n in range(3)])
    monkeypatch.setattr(flight_looks, "original_pixels", lambda *_: picture)
    looks = looks_at(FlightView(root), 0, GroundWindow(150.0, 250.0, 30.0, 32)).looks
    assert [one.image.shape[2] for one in looks] == [bands] * 3
