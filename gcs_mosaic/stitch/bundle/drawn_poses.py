"""Poses over the plane for frames whose ground is not on it.

The map shows the ground from above. A frame over a plateau shows it as one that flies lower over the plane, one over a slope much
as one that is tilted; what is left is the frame's relief displacement. So everything that takes the ground for a plane near a
frame (where its next neighbour is looked for, what their pixels must agree on) keeps working over hills.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from gcs_mosaic.stitch.arrays import PosesNx6, RowsNx3
from gcs_mosaic.stitch.bundle.point_equations import Sums
from gcs_mosaic.stitch.bundle.problem import POSE, Problem
from gcs_mosaic.stitch.bundle.sighted_points import SightedPoints
from gcs_mosaic.stitch.camera import projection

ROUNDS = 20  # of reweighting, at most: flat ground takes four until it stands, a valley ten, a cliff seventeen
STILL = 1e-3  # of the deviations below: a pose that moves no farther stands
SPREAD = 0.05  # half-diagonals: how far points lie off, as roofs and trees do, before they count less
# Standard deviations of a drawn pose about the camera's own over the height of its ground, where few points say otherwise: place
# in flying heights, log of the scale, heading, tilts.
PLACE, ZOOM, TURN, TILT = 0.05, 0.05, 0.05, 0.1
LOWEST = 0.1  # of the flying height: ground cannot rise to the camera


def drawn_poses(problem: Problem, seen: SightedPoints, points: RowsNx3) -> PosesNx6:
    """Poses (n, 6) over the plane that best show the points (t, 3) where they are, seen from above."""
    n, camera = len(problem.poses), problem.camera[seen.row]
    start = _over_own_ground(problem, seen, points)
    height = np.exp(start[:, 2] + problem.lenses[problem.camera, 0]) * problem.half_diagonal[problem.camera]
    sigma = np.stack(
        [PLACE * height, PLACE * height, *np.broadcast_to([[ZOOM], [TURN], [TILT], [TILT]], (4, n))], axis=1
    )
    poses, places, by_frame = start, points[seen.point, :2], Sums.at(seen.row)
    for _ in range(ROUNDS):
        up = projection.pixels_from_canvas(
            poses[seen.row], problem.lens_rows(camera), problem.half_diagonal[camera], places
        )
        off = np.where(up.valid[:, None], up.points - seen.pixels, 0.0)
        weight = np.where(up.valid, 1 / (SPREAD**2 + (off**2).sum(axis=1)), 0.0)
        by = np.where(up.valid[:, None, None], up.by_pose, 0.0) * sigma[seen.row, None, :]
        across = by.transpose(0, 2, 1) * weight[:, None, None]
        equations, slope = np.tile(np.eye(POSE), (n, 1, 1)), (poses - start) / sigma
        by_frame.add(equations, across @ by)
        by_frame.add(slope, (across @ off[:, :, None])[:, :, 0])
        step = np.linalg.solve(equations, slope[:, :, None])[:, :, 0]
        poses = poses - sigma * step
        if (abs(step) < STILL).all():
            break
    return poses


def _over_own_ground(problem: Problem, seen: SightedPoints, points: RowsNx3) -> PosesNx6:
    """Each camera as high over the plane as it is over the median of the points that it sees."""
    order = np.argsort(seen.row, kind="stable")
    ends = np.searchsorted(seen.row[order], np.arange(len(problem.poses) + 1))
    heights = points[seen.point[order], 2]
    ground = np.array([np.median(heights[a:b]) for a, b in pairwise(ends.tolist())])
    poses = problem.poses.copy()
    above = np.exp(poses[:, 2] + problem.lenses[problem.camera, 0]) * problem.half_diagonal[problem.camera]
    poses[:, 2] += np.log(np.maximum(1 - ground / above, LOWEST))
    return poses
