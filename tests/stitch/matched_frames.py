"""The adjustment of frames of one camera whose matches are given."""

from collections.abc import Sequence

import numpy as np

from gcs_mosaic.stitch.arrays import Array
from gcs_mosaic.stitch.bundle.problem import Problem
from gcs_mosaic.stitch.camera.geometry import Camera

SCALE = 4.0  # full-resolution pixels per feature pixel


def problem_of(
    camera: Camera,
    poses: Array,
    lens: Sequence[float],
    pairs: Sequence[tuple[int, int]],
    pixels_a: Sequence[Array],
    pixels_b: Sequence[Array],
) -> Problem:
    """Frames at poses (n, 6) and pairs of them, each with as many matched pixels (k, 2) of either."""
    a, b = ((np.array(pixels) - camera.centre) / camera.half_diagonal for pixels in (pixels_a, pixels_b))
    return Problem(
        poses=poses,
        lenses=np.array([lens]),
        camera=np.zeros(len(poses), int),
        half_diagonal=np.array([camera.half_diagonal]),
        unit_px=np.array([camera.half_diagonal / SCALE]),
        pairs=np.array(pairs),
        pixels_a=a,
        pixels_b=b,
        present=np.ones(a.shape[:2], bool),
        free=np.ones(len(poses), bool),
    )
