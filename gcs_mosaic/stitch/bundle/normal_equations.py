"""Normal equations of an adjustment: assembled from the pairs, and solved.

One block per frame and per linked pair of frames, so the matrix stays sparse however long the flight is; the lenses come last.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from scipy import linalg, sparse
from scipy.sparse.linalg import splu

from gcs_mosaic.stitch.arrays import Indices, Matrices, Matrix, SquareMatrix, Vector
from gcs_mosaic.stitch.bundle.problem import COLUMNS, Problem
from gcs_mosaic.stitch.camera.projection import LENS_TERMS

Normal: TypeAlias = SquareMatrix | sparse.csc_matrix  # dense for few unknowns


def assembled(problem: Problem, blocks: Matrices, slopes: Matrix, diagonal: Vector) -> tuple[Normal, Vector]:
    """Normal matrix and gradient over the free unknowns from one block and slope (COLUMNS) per pair, plus `diagonal`."""
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
    normal = _summed(rows[kept], columns[kept], blocks[kept], diagonal)
    gradient = np.bincount(index[index >= 0], weights=slopes[index >= 0], minlength=size)
    return normal, np.asarray(gradient, dtype=np.float64)


def _summed(rows: Indices, columns: Indices, values: Vector, diagonal: Vector) -> Normal:
    size = len(diagonal)
    if size >= DENSE_BELOW:
        matrix = sparse.coo_matrix((values, (rows, columns)), shape=(size, size)).tocsc()
        return matrix + sparse.diags(diagonal, format="csc")
    dense = np.bincount(rows * size + columns, weights=values, minlength=size**2).astype(np.float64)
    dense[:: size + 1] += diagonal
    return dense.reshape(size, size)


def solve(normal: Normal, gradient: Vector, damping: float) -> Vector:
    """Damped Gauss-Newton step. Unknowns are scaled to a unit diagonal first: canvas units and radians differ by 10^4."""
    scale = 1 / np.sqrt(np.maximum(normal.diagonal(), 1e-12))
    # The gauge freedom (position, heading, scale of the whole) is held by the damping alone.
    held = max(damping, 1e-7)
    if isinstance(normal, np.ndarray):
        damped = normal * scale * scale[:, None]
        damped[np.diag_indices_from(damped)] += held
        step = linalg.solve(damped, scale * gradient, assume_a="pos", check_finite=False)
    else:
        scaling = sparse.diags(scale)
        matrix = (scaling @ normal @ scaling + sparse.identity(len(scale)) * held).tocsc()
        factor = splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
        step = factor.solve(scale * gradient)
    return np.asarray(-scale * step)


DENSE_BELOW = 900  # unknowns up to which the dense factorisation is faster


def unknowns(problem: Problem) -> tuple[Indices, int]:
    """Index of each frame's first unknown (-1 if fixed), and the number of pose unknowns."""
    first = np.where(problem.free, 6 * (np.cumsum(problem.free) - 1), -1)
    return first, 6 * int(problem.free.sum())
