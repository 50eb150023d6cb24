"""What views of flat ground determine when the focal length changes: tilt over focal length, and the ground in the middle.

Tilts and nadir points follow the focal length along a curve. A step of an adjustment is straight, and would have to be short to
stay near it: convergence of a hardly determined focal length would take dozens of steps.
"""

from __future__ import annotations

import numpy as np

from gcs_mosaic.stitch.arrays import Matrix, PointsNx2, PosesNx6, Vector
from gcs_mosaic.stitch.camera.projection import rotations

SMALL = 1e-4  # share of a step over which the derivative along it is taken
STEEPEST = 0.5  # cosine of the tilt beyond which the middle of a frame lies too far away to be held


def along_flat_ground(
    poses: PosesNx6, step: Matrix, log_focal: Vector, log_focal_after: Vector, half_diagonals: Vector
) -> Matrix:
    """What to add to a step (n, 6) of poses (n, 6), so that it leads along the curve: nothing to first order, (n, 6).

    Log focal lengths (n,) before and after it. The line at infinity stays where it was in a frame if the tangent of the tilt
    over the focal length stays.
    """
    change = log_focal_after - log_focal
    sine, cosine = np.sin(poses[:, 4:]), np.cos(poses[:, 4:])
    curved = np.arctan2(np.exp(change)[:, None] * sine, cosine) - np.arctan2(sine, cosine)
    added = np.zeros_like(poses)
    added[:, 4:] = curved - sine * cosine * change[:, None]
    before, ahead, behind = (
        _middle(poses + share * step, log_focal + share * change, half_diagonals) for share in (0, SMALL, -SMALL)
    )
    after = _middle(poses + step + added, log_focal_after, half_diagonals)
    shift = (ahead - behind) / (2 * SMALL) - (after - before)
    added[:, :2] = np.where(np.isfinite(shift).all(axis=1, keepdims=True), shift, 0.0)
    return added


def _middle(poses: PosesNx6, log_focal: Vector, half_diagonals: Vector) -> PointsNx2:
    """Where the optical axis meets the ground, (n, 2) from the nadir point; NaN for steep tilts."""
    rotation, _ = rotations(np.asfortranarray(poses))
    ray = rotation[:, :, 2]
    height = np.exp(poses[:, 2] + log_focal) * half_diagonals
    down = np.where(ray[:, 2] > STEEPEST, ray[:, 2], np.nan)
    return height[:, None] * ray[:, :2] / down[:, None]
