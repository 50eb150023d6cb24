import numpy as np
import pytest

from gcs_mosaic.stitch.camera.geometry import Camera, Pose
from gcs_mosaic.stitch.camera.relief import ReliefDisplacement
from gcs_mosaic.stitch.graph.placement import Placement

CAMERA = Camera(400, 300)
SHIFT = (0.05, 0.0)  # half-diagonals: 12.5 px to the right everywhere


@pytest.fixture
def two_placements() -> list[Placement]:
    """Two level frames of 400 x 300 px, the second 200 canvas units to the right, linked; relief in the second one."""
    relief = ReliefDisplacement.from_grid(np.full((3, 4, 2), SHIFT))
    names = ("a/one.jpg", "a/two.jpg")
    return [
        Placement(name, 0, Pose(200 + 200 * i, 150), CAMERA, relief if i else None, 50, 0.5, (names[1 - i],), i, 0.1)
        for i, name in enumerate(names)
    ]
