"""Covariances of single frames from a sparse normal matrix: the selected inverse.

Of the inverse only the blocks of single frames are needed, and those of frames with their lens; they depend only on blocks where
the factorisation has entries (see `multifrontal`). Going up the tree of fronts eliminates, going down inverts.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from gcs_mosaic.stitch.arrays import Indices, Mask, Matrices, SquareMatrix
from gcs_mosaic.stitch.bundle.elimination import BLOCK, EliminationPiece, Front
from gcs_mosaic.stitch.bundle.multifrontal import MatrixPart, Steps, eliminated, inverted
from gcs_mosaic.stitch.bundle.normal_equations import Normal, Run, handed_on, scaled_part


@dataclass(frozen=True, slots=True)
class Covariances:
    """Blocks of an inverse: of each of k vertices, and with its partner, zero without one."""

    own: Matrices  # (k, BLOCK, BLOCK)
    with_partner: Matrices  # (k, BLOCK, BLOCK), columns of the partner


def covariances(normal: Normal, partners: Indices, known: Mask, run: Run = map) -> Covariances | None:
    """Blocks of the inverse of a normal matrix with v vertices.

    `partners` (v,): a later vertex that each has an edge with, or -1. `known` (v, BLOCK): unknowns taken as exact; their
    covariances are zero. None if the matrix is singular. `run` as in `normal_equations.solve`.
    """
    # A known unknown is decoupled from the others; a unit diagonal keeps the matrix regular.
    scale = np.where(known, 0.0, 1 / np.sqrt(np.maximum(normal.diagonal, 1e-300)))
    plan, held = normal.layout.plan, known[:, :, None] * np.eye(BLOCK)

    def part(piece: EliminationPiece) -> MatrixPart:
        return scaled_part(normal, piece, scale, held[piece.vertices], np.zeros_like(scale))

    try:
        steps, _ = eliminated(part(plan.top), run(handed_on, map(part, plan.tasks)))
    except np.linalg.LinAlgError:
        return None
    found, of_top = _zeros(len(scale)), _zeros(len(plan.top.vertices))
    borders = _selected(steps, _within(plan.top, partners), np.empty((0, 0)), of_top)
    pieces = plan.tasks[::-1]
    tasks = ((part(piece), _within(piece, partners), border) for piece, border in zip(pieces, borders, strict=True))
    for piece, blocks in [*zip(pieces, run(selected, tasks), strict=True), (plan.top, of_top)]:
        found.own[piece.vertices], found.with_partner[piece.vertices] = blocks.own, blocks.with_partner
    of_partner = np.where(partners[:, None] >= 0, scale[partners], 0.0)
    return Covariances(
        found.own * scale[:, :, None] * scale[:, None, :],
        found.with_partner * scale[:, :, None] * of_partner[:, None, :],
    )


def selected(task: tuple[MatrixPart, Indices, SquareMatrix]) -> Covariances:
    """The task of a subtree of k vertices: their blocks, given their partners (k,) and the inverse on its border."""
    part, partners, of_border = task
    found = _zeros(len(part.piece.vertices))
    for _ in _selected(eliminated(part)[0], partners, of_border, found):
        raise AssertionError("a task takes nothing over")
    return found


def _selected(steps: Steps, partners: Indices, of_border: SquareMatrix, found: Covariances) -> Iterator[SquareMatrix]:
    """Find the blocks of a piece's vertices; gives the inverse on the border of each task that it took over, last first."""
    for step, inverse in inverted(steps, of_border):
        if isinstance(step, Front):
            _enter(step, inverse, partners, found)
        else:
            yield inverse


def _enter(front: Front, inverse: SquareMatrix, partners: Indices, found: Covariances) -> None:
    size = len(inverse) // BLOCK
    blocks, each = inverse.reshape(size, BLOCK, size, BLOCK), np.arange(front.last - front.first)
    found.own[front.first : front.last] = blocks[each, :, each]
    of_own = partners[front.first : front.last]
    with_one = np.flatnonzero(of_own >= 0)
    at = np.searchsorted(front.vertices, of_own[with_one])
    found.with_partner[front.first + with_one] = blocks[with_one, :, at]


def _within(piece: EliminationPiece, partners: Indices) -> Indices:
    """Partners (k,) of a piece's vertices, with its own numbers."""
    of_own = partners[piece.vertices]
    return np.where(of_own >= 0, np.searchsorted(np.concatenate([piece.vertices, piece.border]), of_own), -1)


def _zeros(vertices: int) -> Covariances:
    return Covariances(*(np.zeros((vertices, BLOCK, BLOCK)) for _ in range(2)))
