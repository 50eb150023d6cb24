"""Sparse Cholesky factorisation front by front in dense arithmetic; solutions and the selected inverse from it.

A front gathers its entries of the matrix and what the fronts below hand on, eliminates its own vertices, and hands on the Schur
complement on its border (Duff & Reid, ACM TOMS 9(3), 1983). The way back down the tree substitutes, or inverts where the factor
has entries (Takahashi's equations: Erisman & Tinney, CACM 18(3), 1975; by blocks as in Lin et al., SelInv, ACM TOMS 37(4),
2011).

All of it is pure: what comes out for a piece depends neither on where nor beside how many others it is worked on. Symmetric
arrays are upper triangles by rows, which LAPACK reads as lower ones by columns.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.linalg import blas, lapack

from gcs_mosaic.stitch.arrays import Indices, Matrices, Matrix, SquareMatrix, Vector
from gcs_mosaic.stitch.bundle.elimination import BLOCK, EliminationPiece, Front, Handover

Stretches = list[tuple[slice, slice]]


@dataclass(frozen=True, slots=True)
class MatrixPart:
    """What a piece needs of a matrix and of a right-hand side. Picklable."""

    piece: EliminationPiece
    diagonal: Matrices  # (k, BLOCK, BLOCK)
    blocks: Matrices  # (m, BLOCK, BLOCK) of its edges: rows of the earlier vertex
    right: Matrix  # (k, BLOCK)


@dataclass(frozen=True, slots=True)
class Update:
    """What is handed on to a border of b vertices."""

    complement: SquareMatrix  # (b * BLOCK, b * BLOCK)
    right: Vector  # (b * BLOCK,)


@dataclass(frozen=True, slots=True)
class Factor:
    """A front after its elimination: o own unknowns, b of its border."""

    front: Front
    own: SquareMatrix  # (o, o) Cholesky factor
    across: Matrix  # (o, b) its continuation
    right: Vector  # (o,)

    @property
    def border(self) -> Indices:
        return self.front.border


Steps = list[Factor | Handover]  # of a piece, eliminated


def eliminated(part: MatrixPart, below: Iterable[Update] = ()) -> tuple[Steps, Update]:
    """Factors of a piece's fronts, and what it hands on; `below` are the updates that it takes over, in order.

    Raises LinAlgError if the matrix is not positive definite.
    """
    steps, waiting, coming = Steps(), list[tuple[Indices, Update]](), iter(below)
    for step in part.piece.steps:
        if isinstance(step, Handover):
            steps.append(step)
            waiting.append((step.border, next(coming)))
            continue
        taken = waiting[len(waiting) - step.below :]
        del waiting[len(waiting) - step.below :]
        factor, update = _eliminated(part, step, taken)
        steps.append(factor)
        waiting.append((step.border, update))
    return steps, waiting[-1][1]


def _eliminated(part: MatrixPart, front: Front, below: list[tuple[Indices, Update]]) -> tuple[Factor, Update]:
    own, across, complement, right = _gathered(part, front, below)
    o = len(own)
    if not o:  # a cut that nothing crosses; LAPACK takes no empty matrices
        return Factor(front, own, across, right[:0]), Update(complement, right)
    lower, failed = lapack.dpotrf(own.T, lower=1, overwrite_a=1, clean=0)
    if failed:
        raise np.linalg.LinAlgError("the normal matrix is not positive definite")
    forward = blas.dtrsv(lower, right[:o], lower=1)
    if len(complement):
        across = blas.dtrsm(1.0, lower, across.T, side=1, lower=1, trans_a=1, overwrite_b=1).T
        complement = blas.dsyrk(-1.0, across.T, 1.0, complement.T, lower=1, overwrite_c=1).T
    return Factor(front, lower.T, across, forward), Update(complement, right[o:] - forward @ across)


def _gathered(
    part: MatrixPart, front: Front, below: list[tuple[Indices, Update]]
) -> tuple[SquareMatrix, Matrix, SquareMatrix, Vector]:
    """Own block (o, o), that across to the border (o, b), the border's (b, b), and the right-hand side (o + b,)."""
    n, b = front.last - front.first, len(front.border)
    own, across = np.zeros((n, BLOCK, n, BLOCK)), np.zeros((n, BLOCK, b, BLOCK))
    each, (earlier, later), blocks = np.arange(n), front.ends.T, part.blocks[front.edges]
    inside = later < n
    own[each, :, each] = part.diagonal[front.first : front.last]
    own[earlier[inside], :, later[inside]] = blocks[inside]
    across[earlier[~inside], :, later[~inside] - n] = blocks[~inside]
    right = np.zeros((n + b) * BLOCK)
    right[: n * BLOCK] = part.right[front.first : front.last].ravel()
    found = own.reshape((n * BLOCK,) * 2), across.reshape(n * BLOCK, b * BLOCK), np.zeros((b * BLOCK,) * 2), right
    for border, update in below:
        _take_over(_stretches(front, border), update, *found)
    return found


def _take_over(
    stretches: Stretches, update: Update, own: SquareMatrix, across: Matrix, complement: SquareMatrix, right: Vector
) -> None:
    o = len(own)
    for number, (rows, to_rows) in enumerate(stretches):
        right[to_rows] += update.right[rows]
        for columns, to_columns in stretches[number:]:
            some = update.complement[rows, columns]
            if to_columns.start < o:
                own[to_rows, to_columns] += some
            elif to_rows.start < o:
                across[to_rows, _less(to_columns, o)] += some
            else:
                complement[_less(to_rows, o), _less(to_columns, o)] += some


def _stretches(front: Front, border: Indices) -> Stretches:
    """Where unknowns of these vertices (b,) lie side by side, there and in a front; its own and others are kept apart."""
    at = np.searchsorted(front.vertices, border)
    breaks = np.flatnonzero((np.diff(at) != 1) | (at[1:] == front.last - front.first)) + 1
    bounds = [0, *breaks.tolist(), len(at)] if len(at) else [0]
    return [
        (slice(BLOCK * start, BLOCK * stop), slice(BLOCK * int(at[start]), BLOCK * (int(at[stop - 1]) + 1)))
        for start, stop in pairwise(bounds)
    ]


def _less(some: slice, by: int) -> slice:
    return slice(some.start - by, some.stop - by)


def substituted(steps: Steps, piece: EliminationPiece, of_border: Matrix) -> Matrix:
    """Solution (k, BLOCK) for a piece's vertices, given that for its border (b, BLOCK)."""
    solution = np.concatenate([np.zeros((len(piece.vertices), BLOCK)), of_border])
    for factor in reversed(steps):
        if isinstance(factor, Factor) and len(factor.own):
            right = factor.right - factor.across @ solution[factor.border].ravel()
            own = blas.dtrsv(factor.own.T, right, lower=1, trans=1, overwrite_x=1)
            solution[factor.front.first : factor.front.last] = own.reshape(-1, BLOCK)
    return solution[: len(piece.vertices)]


def inverted(steps: Steps, of_border: SquareMatrix) -> Iterator[tuple[Front | Handover, SquareMatrix]]:
    """The inverse on the vertices of each front and on the border of each handover, last first; consumes `steps`.

    `of_border` (b * BLOCK, b * BLOCK): the inverse on the piece's border.
    """
    above = list[tuple[Front, SquareMatrix]]()  # once for each update that the front has taken over
    while steps:
        step = steps.pop()
        known = _on(step.border, *above.pop()) if above else of_border
        if isinstance(step, Handover):
            yield step, known
        else:
            whole = _inverted(step, known)
            above += [(step.front, whole)] * step.front.below
            yield step.front, whole


def _on(border: Indices, front: Front, whole: SquareMatrix) -> SquareMatrix:
    """The part of a front's inverse that is on these vertices (b,)."""
    found, stretches = np.empty((BLOCK * len(border),) * 2), _stretches(front, border)
    for rows, from_rows in stretches:
        for columns, from_columns in stretches:
            found[rows, columns] = whole[from_rows, from_columns]
    return found


def _inverted(factor: Factor, of_border: SquareMatrix) -> SquareMatrix:
    """The inverse on a front's vertices, given that on its border."""
    o, b = factor.across.shape
    whole = np.empty((o + b, o + b))
    whole[o:, o:] = of_border
    if not o:
        return whole
    own = lapack.dpotri(factor.own.T, lower=1, overwrite_c=0)[0].T
    whole[:o, :o] = np.triu(own) + np.triu(own, 1).T
    if b:
        gain = blas.dtrsm(1.0, factor.own.T, factor.across.T, side=1, lower=1, trans_a=0).T
        whole[:o, o:] = -gain @ of_border
        whole[o:, :o] = whole[:o, o:].T
        whole[:o, :o] -= whole[:o, o:] @ gain.T
    return whole
