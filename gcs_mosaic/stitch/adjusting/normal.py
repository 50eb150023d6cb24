"""The normal equations of an adjustment: put together from the pairs, and solved.

One block per frame and per linked pair of frames, so the matrix stays sparse however long the flight is; the lenses stand
at its end.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, sparse
from scipy.sparse.linalg import splu

from gcs_mosaic.stitch.adjusting.problem import COLUMNS, Problem
from gcs_mosaic.stitch.projection import LENS_TERMS

Array = NDArray[np.float64]


def assembled(problem: Problem, blocks: Array, slopes: Array) -> tuple[sparse.csc_matrix, Array]:
    """Normal matrix and gradient over the free unknowns from one block and slope (COLUMNS) per pair."""
    first, pose_unknowns = unknowns(problem)
    size = pose_unknowns + (LENS_TERMS * len(problem.lenses) if problem.lens_free else 0)
    index = np.full((len(problem.pairs), COLUMNS), -1)
    for side in (0, 1):
        frame = problem.pairs[:, side]
        moves = problem.free[frame]
        index[moves, 6 * side : 6 * side + 6] = first[frame[moves], None] + np.arange(6)
        if problem.lens_free:
            lens = pose_unknowns + LENS_TERMS * problem.camera[frame]
            begin = 12 + LENS_TERMS * side
            index[:, begin : begin + LENS_TERMS] = lens[:, None] + np.arange(LENS_TERMS)
    rows, columns = np.broadcast_arrays(index[:, :, None], index[:, None, :])
    kept = (rows >= 0) & (columns >= 0)
    normal = sparse.coo_matrix((blocks[kept], (rows[kept], columns[kept])), shape=(size, size)).tocsc()
    gradient = np.bincount(index[index >= 0], weights=slopes[index >= 0], minlength=size)
    return normal, np.asarray(gradient, dtype=np.float64)


def solve(normal: sparse.csc_matrix, gradient: Array, damping: float) -> Array:
    """Damped Gauss-Newton step. Unknowns are scaled to a unit diagonal first: canvas units and radians differ by 10^4."""
    scale = 1 / np.sqrt(np.maximum(normal.diagonal(), 1e-12))
    scaling = sparse.diags(scale)
    # What the matches leave open (position, heading, scale of the whole) is held by the damping alone.
    damped = (scaling @ normal @ scaling + sparse.identity(len(scale)) * max(damping, 1e-7)).tocsc()
    if len(gradient) < DENSE_BELOW:
        step = linalg.solve(damped.toarray(), scale * gradient, assume_a="pos", check_finite=False)
    else:
        factor = splu(damped, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
        step = factor.solve(scale * gradient)
    return np.asarray(-scale * step)


DENSE_BELOW = 900  # unknowns up to which the dense factorisation is the faster one


def unknowns(problem: Problem) -> tuple[NDArray[np.intp], int]:
    """Index of each frame's first unknown, -1 where it is fixed, and the number of pose unknowns."""
    first = np.where(problem.free, 6 * (np.cumsum(problem.free) - 1), -1)
    return first, 6 * int(problem.free.sum())
