"""What an adjustment is given: frames, lenses and the matches between them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.stitch.camera.projection import LENS_TERMS

Array = NDArray[np.float64]

POSE = 6  # unknowns of a frame
COLUMNS = 2 * (POSE + LENS_TERMS)  # unknowns that a pair depends on: pose a, pose b, lens a, lens b


@dataclass(frozen=True, slots=True, kw_only=True)
class Problem:
    """What is adjusted. n frames, c cameras, p linked pairs with up to k matches each.

    Pixels are centred on the frame and divided by its half-diagonal. `unit_px` turns that into pixels of the feature picture.
    """

    poses: Array  # (n, 6)
    lenses: Array  # (c, 5): log focal, k1, k2, shift_x, shift_y
    camera: NDArray[np.intp]  # (n,)
    half_diagonal: Array  # (c,) full-resolution pixels
    unit_px: Array  # (c,)
    pairs: NDArray[np.intp]  # (p, 2) frame indices
    pixels_a: Array  # (p, k, 2)
    pixels_b: Array  # (p, k, 2)
    present: NDArray[np.bool_]  # (p, k)
    free: NDArray[np.bool_]  # (n,) frames that may move
    relief: float = 0.0  # standard deviation of the ground's heights about the plane, canvas units
    lens_free: bool = True
    # (2, c, 5): what is expected of the lenses before any match, and its standard deviation; None: what is of any lens
    lens_prior: Array | None = None
