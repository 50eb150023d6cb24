"""What frames are told of each other's brightness outlasts what happens to them between two steps of repainting."""

from dataclasses import replace

import numpy as np
from painting_parts import painted, picture

from gcs_mosaic.render.brightness import Brightness
from gcs_mosaic.render.exposure import ExposureSettings
from gcs_mosaic.render.vignetting import VignettingSettings
from gcs_mosaic.stitch.camera.dead_border import NO_BORDER


def test_an_overlap_outlasts_the_moving_of_one_island_to_another() -> None:
    """Of two frames whose island has been joined to another one, only the first is painted there when a border is found."""
    brightness = Brightness(ExposureSettings(), VignettingSettings(), lambda size: NO_BORDER)
    light, dark = picture(0).astype(np.float32), (picture(0) * 0.7).astype(np.float32)
    one = brightness.settled(painted(0), light, [])
    other = brightness.settled(painted(1), dark, [one])
    assert other.gain != one.gain
    there = {one.name: one, other.name: other}
    known = brightness.final(there)
    moved = replace(one, island=1, pose=replace(one.pose, x=5000.0))
    brightness.compare_again(there | {one.name: moved}, there)
    assert brightness.final(there) == known
