import math
from dataclasses import replace

import pytest
from painting_parts import painted

from gcs_mosaic.render.displacement import displacement
from gcs_mosaic.stitch.camera.geometry import Camera, Pose, reduced_view
from tests.factories import placement


@pytest.mark.parametrize("reduction", [1, 2, 4])
@pytest.mark.parametrize("by", [0.0, 2.5])
def test_a_frame_is_off_by_what_it_has_moved_whatever_it_is_reduced_by(reduction: int, by: float) -> None:
    camera, pose = Camera(4000, 3000, 1.2, k1=-0.02), Pose(10.0, 20.0, 0.1, 0.3, 0.02, -0.01)
    reduced, small = reduced_view(pose, camera, camera.width // reduction, camera.height // reduction)
    there = replace(painted(0), pose=reduced, camera=small)
    moved = placement("0.jpg", Pose(10.0 + by, 20.0, 0.1, 0.3, 0.02, -0.01), camera)
    assert displacement(there, moved) == pytest.approx(by / math.exp(0.1), abs=1e-6)
