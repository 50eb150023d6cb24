"""Input of an adjustment: frames, lenses and the matches between them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.stitch.camera.projection import LENS_TERMS

Array = NDArray[np.float64]

POSE = 6  # unknowns per frame
COLUMNS = 2 * (POSE + LENS_TERMS)  # unknowns that a pair depends on: pose a, pose b, lens a, lens b


@dataclass(frozen=True, slots=True, kw_only=True)
class Problem:
    """An adjustment problem: n frames, c cameras, p linked pairs with up to k matches each.

    Pixels are centred on the frame and divided by its half-diagonal. `unit_px` converts that to pixels of the feature picture.
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
    relief: float = 0.0  # standard deviation of terrain height about the plane, canvas units
    lens_free: bool = True
    # (2, c, 5): prior mean and standard deviation of the lenses; None: those of any lens
    lens_prior: Array | None = None
