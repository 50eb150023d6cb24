"""Normal equations of an adjustment: assembled from the pairs, and solved.

A frame that may move is a vertex with one block of unknowns, a lens is another; two vertices that a match depends on have a block
in common. So the matrix stays sparse however long the flight is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from gcs_mosaic.stitch.arrays import AnyArray, Array, IndexPairsNx2, Indices, Matrices, Matrix
from gcs_mosaic.stitch.bundle.dissection import dissected
from gcs_mosaic.stitch.bundle.elimination import BLOCK, EliminationPiece, EliminationPlan, planned
from gcs_mosaic.stitch.bundle.multifrontal import MatrixPart, Update, eliminated, substituted
from gcs_mosaic.stitch.bundle.problem import POSE, Problem
from gcs_mosaic.stitch.camera.projection import LENS_TERMS

# Runs a function on each of some arguments, here or on other machines; results come in order, as from `map`.
Run: TypeAlias = Callable[[Callable[[Any], Any], Iterable[Any]], Iterable[Any]]

ENDS = 4  # vertices that a pair depends on: pose a, pose b, lens a, lens b
# Places of a pair's unknowns when each of these has a whole block.
PLACES = np.concatenate([np.arange(2 * BLOCK), *(side * BLOCK + np.arange(LENS_TERMS) for side in (2, 3))])


@dataclass(frozen=True, slots=True)
class EquationLayout:
    """Vertices of an adjustment in order of elimination, and its edges: pairs of vertices that have a block in common.

    A lens has fewer terms than a block has places: the last is an unknown that nothing depends on.
    """

    frames: Indices  # (n,) each frame's vertex, -1 if it is fixed
    lenses: Indices  # (c,) each lens' vertex, -1 if they are fixed
    edges: IndexPairsNx2  # (e, 2) the earlier vertex first, sorted
    entries: AnyArray  # (p, ENDS, ENDS) where blocks of pairs are added: a vertex, v + an edge, or -1 for nowhere
    plan: EliminationPlan

    @property
    def vertices(self) -> int:
        return int((self.frames >= 0).sum() + (self.lenses >= 0).sum())

    @property
    def unknowns(self) -> int:
        return int(POSE * (self.frames >= 0).sum() + LENS_TERMS * (self.lenses >= 0).sum())

    def edges_between(self, first: Indices, second: Indices) -> Indices:
        """Where the blocks of these pairs of vertices (k,) are in a `Normal`; each pair must be an edge, in its order."""
        keys = self.edges @ np.array([self.vertices, 1])
        return self.vertices + np.searchsorted(keys, first * self.vertices + second)


def layout_of(problem: Problem) -> EquationLayout:
    """Layout by the places of a problem's frames and by its pairs."""
    free, lenses = np.flatnonzero(problem.free), np.full(len(problem.lenses), -1)
    links = (np.cumsum(problem.free) - 1)[problem.pairs[problem.free[problem.pairs].all(axis=1)]]
    tree = dissected(links, problem.poses[free, :2])
    parts = [part.frames for part in tree.in_order()]
    frames = np.full(len(problem.free), -1)
    frames[free[np.concatenate(parts)]] = np.arange(len(free))
    sizes = [len(part) for part in parts]
    if problem.lens_free:  # common to many frames, so they come last
        lenses = len(free) + np.arange(len(lenses))
        sizes[-1] += len(lenses)
    edges, entries = _edges(frames, lenses[problem.camera], problem.pairs, sum(sizes))
    return EquationLayout(frames, lenses, edges, entries, planned(tree, sizes, edges))


def _edges(frames: Indices, lenses: Indices, pairs: IndexPairsNx2, vertices: int) -> tuple[IndexPairsNx2, AnyArray]:
    """Edges and entries as in `EquationLayout`; `lenses` (n,): the vertex of each frame's lens."""
    ends = np.concatenate([frames[pairs], lenses[pairs]], axis=1)
    first, second = np.broadcast_arrays(ends[:, :, None], ends[:, None, :])
    kept = (first >= 0) & (first <= second)  # of the two orders of two vertices; a lens of both frames has both orders
    keys = np.where(kept, first * vertices + second, -1)
    own = (frames >= 0) & (lenses >= 0)  # a frame and its lens, though nothing may have been matched
    wanted = np.unique(np.concatenate([keys[kept & (first < second)], frames[own] * vertices + lenses[own]]))
    at = np.where(first == second, first, vertices + np.searchsorted(wanted, keys))
    entries = np.where(kept, at, -1).astype(np.int32)
    return np.stack(np.divmod(wanted, max(vertices, 1)), axis=1), entries


@dataclass(frozen=True, slots=True)
class Normal:
    """Normal matrix of a layout with v vertices and e edges: the vertices' own blocks, then those of the edges."""

    layout: EquationLayout
    blocks: Matrices  # (v + e, BLOCK, BLOCK); of an edge: rows of its first vertex

    @property
    def diagonal(self) -> Matrix:
        """(v, BLOCK)"""
        return np.diagonal(self.blocks[: self.layout.vertices], axis1=1, axis2=2)

    def dense(self) -> Array:
        """All of it, (v * BLOCK, v * BLOCK), for few vertices."""
        v, (first, second) = self.layout.vertices, self.layout.edges.T
        whole = np.zeros((v, BLOCK, v, BLOCK))
        whole[np.arange(v), :, np.arange(v)] = self.blocks[:v]
        whole[first, :, second] = self.blocks[v:]
        whole[second, :, first] = self.blocks[v:].transpose(0, 2, 1)
        return whole.reshape(v * BLOCK, v * BLOCK)

    def columns(self, vertices: Indices) -> Array:
        """The columns of g vertices, (v, BLOCK, g * BLOCK)."""
        v, (first, second) = self.layout.vertices, self.layout.edges.T
        found = np.zeros((v, BLOCK, len(vertices), BLOCK))
        for number, vertex in enumerate(vertices.tolist()):
            found[vertex, :, number] = self.blocks[vertex]
            found[first[second == vertex], :, number] = self.blocks[v:][second == vertex]
            found[second[first == vertex], :, number] = self.blocks[v:][first == vertex].transpose(0, 2, 1)
        return found.reshape(v, BLOCK, -1)

    def with_columns(self, vertices: Indices, columns: Array) -> Normal:
        """The matrix with other columns of g vertices, and such rows; what has no block in it is left out."""
        v, (first, second) = self.layout.vertices, self.layout.edges.T
        blocks, columns = self.blocks.copy(), columns.reshape(v, BLOCK, len(vertices), BLOCK)
        for number, vertex in enumerate(vertices.tolist()):
            blocks[vertex] = columns[vertex, :, number]
            blocks[v:][second == vertex] = columns[first[second == vertex], :, number]
            blocks[v:][first == vertex] = columns[second[first == vertex], :, number].transpose(0, 2, 1)
        return Normal(self.layout, blocks)


def blank(layout: EquationLayout) -> tuple[Normal, Matrix]:
    """Normal matrix and gradient (v, BLOCK) of a layout without matches: zero, but for what only fills a lens' block."""
    v = layout.vertices
    blocks = np.zeros((v + len(layout.edges), BLOCK, BLOCK))
    blocks[layout.lenses[layout.lenses >= 0], LENS_TERMS:, LENS_TERMS:] = np.eye(BLOCK - LENS_TERMS)
    return Normal(layout, blocks), np.zeros((v, BLOCK))


def add_pairs(normal: Normal, gradient: Matrix, pairs: slice, blocks: Matrices, slopes: Matrix) -> None:
    """Add the contributions of some of the layout's pairs: (q, COLUMNS, COLUMNS) and (q, COLUMNS)."""
    wide = np.zeros((len(blocks), ENDS * BLOCK, ENDS * BLOCK))
    wide[:, PLACES[:, None], PLACES] = blocks
    slope = np.zeros((len(blocks), ENDS * BLOCK))
    slope[:, PLACES] = slopes
    entries = normal.layout.entries[pairs]
    of_ends = wide.reshape(-1, ENDS, BLOCK, ENDS, BLOCK).transpose(0, 1, 3, 2, 4)
    _add(normal.blocks, entries, of_ends)
    _add(gradient, entries[:, np.arange(ENDS), np.arange(ENDS)], slope.reshape(-1, ENDS, BLOCK))


def _add(sums: Array, entries: AnyArray, values: Array) -> None:
    """Add values (..., *shape) to sums (s, *shape) at these entries (...), none where that is negative, in order."""
    kept = entries >= 0
    size = sums[0].size if len(sums) else 0
    at = entries[kept][:, None] * size + np.arange(size)
    np.add.at(sums.reshape(-1), at.ravel(), values[kept].ravel())


def solve(normal: Normal, gradient: Matrix, damping: float, run: Run = map) -> Matrix | None:
    """Damped Gauss-Newton step (v, BLOCK); None if the damped matrix is not positive definite, so that there is none.

    Unknowns are scaled to a unit diagonal first: canvas units and radians differ by 10^4. `run` is given subtrees of a large
    matrix, each a task of its own; it does not change the result.
    """
    scale = 1 / np.sqrt(np.maximum(normal.diagonal, 1e-12))
    # The gauge freedom (position, heading, scale of the whole) is held by the damping alone.
    held = np.eye(BLOCK) * max(damping, 1e-7)
    plan = normal.layout.plan

    def part(piece: EliminationPiece) -> MatrixPart:
        return scaled_part(normal, piece, scale, held, gradient)

    try:
        steps, _ = eliminated(part(plan.top), run(handed_on, map(part, plan.tasks)))
        solution = np.zeros_like(scale)
        solution[plan.top.vertices] = substituted(steps, plan.top, np.empty((0, BLOCK)))
        tasks = ((part(piece), solution[piece.border]) for piece in plan.tasks)
        for piece, found in zip(plan.tasks, run(resolved, tasks), strict=True):
            solution[piece.vertices] = found
    except np.linalg.LinAlgError:
        return None
    return -scale * solution if np.isfinite(solution).all() else None


def scaled_part(normal: Normal, piece: EliminationPiece, scale: Matrix, added: Matrices, right: Matrix) -> MatrixPart:
    """A piece of the matrix and of the right-hand side (v, BLOCK), rows and columns scaled (v, BLOCK); `added` to its diagonal
    blocks ((k,) BLOCK, BLOCK) after that."""
    v = normal.layout.vertices
    first, second = normal.layout.edges[piece.edges].T
    own = scale[piece.vertices]
    return MatrixPart(
        piece=piece,
        diagonal=normal.blocks[piece.vertices] * own[:, :, None] * own[:, None, :] + added,
        blocks=normal.blocks[v + piece.edges] * scale[first, :, None] * scale[second, None, :],
        right=own * right[piece.vertices],
    )


def handed_on(part: MatrixPart) -> Update:
    """The task of a subtree on the way up: what it adds to the equations of its border."""
    return eliminated(part)[1]


def resolved(task: tuple[MatrixPart, Matrix]) -> Matrix:
    """The task of a subtree on the way back: its solution (k, BLOCK), given that of its border (b, BLOCK)."""
    part, of_border = task
    return substituted(eliminated(part)[0], part.piece, of_border)
