"""An elastic sheet over a frame: a grid robustly fitted to values at places, smooth but for steps that many values show.

It is a membrane that resists stretching and is weakly tied to zero. Where it steps nevertheless it resists less, as at the foot
of a wall, so that what lies beside is not drawn along (a robust smoothness term, after Black and Anandan 1996).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solveh_banded

from gcs_mosaic.stitch.arrays import Array, IndexRows, Matrix, PointsNx2, Vector
from gcs_mosaic.stitch.camera.geometry import Camera

# Scales of the loss in units of its own, round by round: as it is; and begun wide, so that a roof of few values is not taken for
# wrong ones (graduated non-convexity, Blake and Zisserman 1987).
PLAIN, GRADUATED = (1, 1, 1, 1), (8, 4, 2, 1)


@dataclass(frozen=True, slots=True)
class Elasticity:
    """Relative to one value, which pulls at the sheet as far as `loss` and no farther (Cauchy)."""

    stiffness: float
    step: float  # beyond it neighbours resist less
    tie: float
    loss: float
    rounds: tuple[float, ...] = PLAIN


def grid_size(camera: Camera, cells: int) -> tuple[int, int]:
    """Columns and rows of a grid of nearly square cells, `cells` along the longer side."""
    longer = max(camera.width, camera.height)
    return (max(2, round(cells * camera.width / longer) + 1), max(2, round(cells * camera.height / longer) + 1))


def fitted_sheet(
    at: PointsNx2, values: Matrix, size: tuple[int, int], elasticity: Elasticity, weight: Vector | None = None
) -> Array:
    """A sheet (rows, columns, k) robustly fitted to values (m, k) at places (m, 2), 0 to 1 along each side, each of which counts
    by its `weight` (m,), at most 1; size: columns and rows."""
    columns, rows = size
    share = np.ones(len(at)) if weight is None else weight
    corners = _Corners.of(at, columns, rows)
    sheet, pull = np.zeros((rows, columns, values.shape[1])), share
    for wider in elasticity.rounds:
        band = _membrane(sheet, elasticity) + corners.normal_matrix(pull)
        found = solveh_banded(band, corners.right_side(pull, values), lower=True, check_finite=False)
        sheet = np.asarray(found).reshape(sheet.shape)
        off = corners.values_of(sheet) - values
        pull = share / (1 + np.einsum("mk,mk->m", off, off) / (wider * elasticity.loss) ** 2)
    return sheet


def on_sheet(sheet: Array, at: PointsNx2) -> Matrix:
    """Values (m, k) of a sheet (rows, columns, k) at places (m, 2)."""
    return _Corners.of(at, sheet.shape[1], sheet.shape[0]).values_of(sheet)


@dataclass(frozen=True, slots=True)
class _Corners:
    """The four nodes (m, 4) around each place, ascending, and their bilinear weights (m, 4)."""

    node: IndexRows
    share: Matrix
    columns: int
    rows: int

    @classmethod
    def of(cls, at: PointsNx2, columns: int, rows: int) -> _Corners:
        cell = at * [columns - 1, rows - 1]
        first = np.clip(cell.astype(np.intp), 0, [columns - 2, rows - 2])
        x, y = (cell - first).T
        node = (first[:, 1] * columns + first[:, 0])[:, None] + np.array([0, 1, columns, columns + 1])
        return cls(node, np.stack([(1 - x) * (1 - y), x * (1 - y), (1 - x) * y, x * y], axis=1), columns, rows)

    def normal_matrix(self, weight: Vector) -> Matrix:
        """Of values that count by `weight` (m,): (columns + 2, n), as lower diagonals."""
        n, beyond = self.columns * self.rows, (0, 1, self.columns, self.columns + 1)
        band = np.zeros((self.columns + 2, n))
        for i in range(4):
            for j in range(i, 4):
                band[beyond[j] - beyond[i]] += np.bincount(
                    self.node[:, i], weight * self.share[:, i] * self.share[:, j], n
                )
        return band

    def right_side(self, weight: Vector, values: Matrix) -> Matrix:
        n, node = self.columns * self.rows, self.node.ravel()
        shares = self.share * weight[:, None]
        return np.stack([np.bincount(node, (shares * one[:, None]).ravel(), n) for one in values.T], axis=1)

    def values_of(self, sheet: Array) -> Matrix:
        return np.asarray(np.einsum("mc,mck->mk", self.share, sheet.reshape(-1, sheet.shape[2])[self.node]))


def _membrane(sheet: Array, elasticity: Elasticity) -> Matrix:
    """Normal matrix (columns + 2, n) of the sheet alone, as lower diagonals."""
    rows, columns = sheet.shape[:2]
    band = np.zeros((columns + 2, columns * rows))
    band[0] = elasticity.tie
    nodes = np.arange(columns * rows).reshape(rows, columns)
    for step, axis, first in ((1, 1, nodes[:, :-1].ravel()), (columns, 0, nodes[:-1].ravel())):
        steps2 = (np.diff(sheet, axis=axis) ** 2).sum(axis=2).ravel()
        stiffness = elasticity.stiffness / (1 + steps2 / elasticity.step**2)
        band[step, first] -= stiffness
        band[0, first] += stiffness
        band[0, first + step] += stiffness
    return band
