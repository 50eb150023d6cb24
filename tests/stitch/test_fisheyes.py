"""A flight with an action camera: its map is as straight as that of any other."""

from __future__ import annotations

import math

import numpy as np
import pytest
from stitch_ground import map_error, photograph, textured_ground

from gcs_mosaic.stitch.camera.geometry import Camera, Pose
from gcs_mosaic.stitch.mosaic import Mosaic

CAMERA = Camera(480, 360, focal=1.0, fisheye=True)  # 115 degrees across its diagonal
SIDE = 2400  # px of the ground


def survey() -> list[Pose]:
    """Two lines of six frames there and back, each tilted a little."""
    rng, poses = np.random.default_rng(4), []
    for line, y in enumerate((900.0, 1250.0)):
        along = [600.0 + 240 * k for k in range(6)]
        for x in reversed(along) if line else along:
            pitch, roll, turn = rng.normal(0, 0.04, 3)
            poses.append(Pose(x, y, 0.35, math.pi * line + turn, pitch, roll))
    return poses


@pytest.mark.long
def test_a_flight_with_a_fisheye_is_one_straight_map() -> None:
    """As any other lens it bends the map by 26 px."""
    ground, poses, mosaic = textured_ground(SIDE, 8), survey(), Mosaic()
    for number, pose in enumerate(poses):
        mosaic.add(photograph(ground, pose, CAMERA), f"{number:03}")
        if number % 4 == 3:
            mosaic.adjust()
    mosaic.retry_waiting()
    mosaic.adjust(everything=True)
    placed = mosaic.placements()
    assert mosaic.frame_counts() == {0: len(poses)}
    assert all(placement.camera.fisheye for placement in placed)
    assert placed[0].camera.focal == pytest.approx(CAMERA.focal, rel=0.05)
    assert map_error(placed, poses, CAMERA) < 3.0
