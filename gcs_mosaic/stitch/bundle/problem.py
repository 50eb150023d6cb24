"""Input of an adjustment: frames, lenses and the matches between them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gcs_mosaic.stitch.arrays import (
    Array,
    IndexPairsNx2,
    Indices,
    LensesNx5,
    LensRowsNx6,
    Mask,
    Matrices,
    PairPoints,
    PointsNx2,
    PosesNx6,
    Vector,
)
from gcs_mosaic.stitch.camera.projection import LENS_TERMS, lens_rows

POSE = 6  # unknowns per frame
COLUMNS = 2 * (POSE + LENS_TERMS)  # unknowns that a pair depends on: pose a, pose b, lens a, lens b


@dataclass(frozen=True, slots=True, kw_only=True)
class Problem:
    """An adjustment problem: n frames, c cameras, p linked pairs with up to k matches each.

    Pixels are centred on the frame and divided by its half-diagonal. `unit_px` converts that to pixels of the feature picture.
    """

    poses: PosesNx6  # (n, 6)
    lenses: LensesNx5  # (c, 5): log focal, k1, k2, shift_x, shift_y
    camera: Indices  # (n,)
    half_diagonal: Vector  # (c,) full-resolution pixels
    unit_px: Vector  # (c,)
    pairs: IndexPairsNx2  # (p, 2) frame indices
    pixels_a: PairPoints  # (p, k, 2)
    pixels_b: PairPoints  # (p, k, 2)
    present: Mask  # (p, k)
    free: Mask  # (n,) frames that may move
    relief: float = 0.0  # standard deviation of terrain height about the plane, canvas units
    lens_free: bool = True
    # (2, c, 5): prior mean and standard deviation of the lenses; None: those of any lens
    lens_prior: Array | None = None
    # (c, 5, 5): inverse covariances that the prior is held with; None: by its deviations
    lens_weights: Matrices | None = None
    # (c, 2): pitch and roll that the frames of a camera are expected to have; None: level ones
    tilt_prior: PointsNx2 | None = None
    fisheye: Mask | None = None  # (c,) lenses that are; None: none is

    def lens_rows(self, cameras: Indices) -> LensRowsNx6:
        """Rows (m, 6), as in `projection`, of the lenses of these cameras (m,)."""
        fisheye = np.zeros(len(self.lenses), bool) if self.fisheye is None else self.fisheye
        return lens_rows(self.lenses, fisheye)[cameras]
