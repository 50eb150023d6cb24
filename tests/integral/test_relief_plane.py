"""Of a frame's relief slopes are kept and crowns are not."""

import numpy as np
import pytest

from gcs_mosaic.integral.relief_plane import plane_of
from gcs_mosaic.stitch.camera.geometry import Camera
from gcs_mosaic.stitch.camera.relief import ReliefDisplacement
from tests.sure import sure

CAMERA = Camera(320, 240)
LOW, HIGH = np.array([100.0, 80.0]), np.array([200.0, 160.0])
AT = np.array([[120.0, 90.0], [180.0, 150.0], [150.0, 120.0]])


def relief(bump: float, slope: float) -> ReliefDisplacement:
    """Shifts in half-diagonals: a slope across the frame, and a bump in its middle."""
    x, y = np.meshgrid(np.linspace(-1, 1, 17), np.linspace(-1, 1, 13))
    across = slope * x + bump * np.exp(-(x**2 + y**2) / 0.02)
    return ReliefDisplacement.from_grid(np.dstack([across, 0 * across]))


def test_a_slope_is_kept() -> None:
    whole = relief(0.0, 0.02)
    kept = sure(plane_of(whole, CAMERA, LOW, HIGH))
    assert kept.at(CAMERA, AT) == pytest.approx(whole.at(CAMERA, AT), abs=0.1)


def test_a_crown_is_not_followed() -> None:
    whole = relief(0.02, 0.0)
    crown = np.array([[159.5, 119.5]])
    assert abs(whole.at(CAMERA, crown)[0, 0]) > 2
    assert abs(sure(plane_of(whole, CAMERA, LOW, HIGH)).at(CAMERA, crown)[0, 0]) < 0.5


def test_without_relief_there_is_none() -> None:
    assert plane_of(None, CAMERA, LOW, HIGH) is None
