"""The step of an adjustment by SuperLU, a general sparse solver: what the program's own is compared with."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from gcs_mosaic.stitch.arrays import Matrix
from gcs_mosaic.stitch.bundle.elimination import BLOCK
from gcs_mosaic.stitch.bundle.normal_equations import Normal


def sparse_of(normal: Normal) -> sparse.csc_matrix:
    """The whole matrix, (v * BLOCK, v * BLOCK)."""
    v, (first, second) = normal.layout.vertices, normal.layout.edges.T
    at = np.arange(v)
    rows, columns = np.concatenate([at, first, second]), np.concatenate([at, second, first])
    blocks = np.concatenate([normal.blocks, normal.blocks[v:].transpose(0, 2, 1)])
    shape = blocks.shape
    inner = np.broadcast_to(np.arange(BLOCK)[:, None], shape), np.broadcast_to(np.arange(BLOCK), shape)
    index = (BLOCK * rows[:, None, None] + inner[0], BLOCK * columns[:, None, None] + inner[1])
    return sparse.coo_matrix((blocks.ravel(), [part.ravel() for part in index]), shape=(v * BLOCK,) * 2).tocsc()


def superlu_step(normal: Normal, gradient: Matrix, damping: float) -> Matrix:
    """As `normal_equations.solve`; of a matrix that is not positive definite it gives some step as well."""
    scale = 1 / np.sqrt(np.maximum(normal.diagonal, 1e-12)).ravel()
    scaling = sparse.diags(scale)
    damped = scaling @ sparse_of(normal) @ scaling + sparse.identity(len(scale)) * max(damping, 1e-7)
    factor = splu(damped.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    return np.asarray(-scale * factor.solve(scale * gradient.ravel())).reshape(-1, BLOCK)
