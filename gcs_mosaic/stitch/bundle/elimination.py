"""In which steps a sparse matrix is eliminated, and which of them make a task of their own; found once for an adjustment.

A matrix consists of blocks of `BLOCK` unknowns, one for each vertex; its edges are the pairs of vertices whose blocks are not
zero. Vertices are numbered in order of elimination. A front is what one step works on: the vertices it eliminates, and the
later ones that depend on them (Duff & Reid, ACM TOMS 9(3), 1983).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gcs_mosaic.stitch.arrays import IndexPairsNx2, Indices
from gcs_mosaic.stitch.bundle.dissection import Separator

BLOCK = 6  # unknowns of a vertex
# A matrix of so many vertices is eliminated as a whole: its factor takes 200 MB. Of a larger one only the factor of the tree's
# top is held; those of subtrees, of at most so many vertices each, are made again on the way back.
WHOLE_VERTICES, TASK_VERTICES = 10_000, 2_000


@dataclass(frozen=True, slots=True)
class Front:
    """Eliminates vertices `first` to `last` - 1. Vertices and edges are numbered within its piece."""

    first: int
    last: int
    border: Indices  # (b,) vertices that depend on those, ascending
    edges: slice  # that begin at its own vertices
    ends: IndexPairsNx2  # (m, 2) of these edges: places in `vertices`
    below: int  # number of updates that it takes over, the last that were handed on

    @property
    def vertices(self) -> Indices:
        """Its own, then the border; ascending."""
        return np.concatenate([np.arange(self.first, self.last), self.border])


@dataclass(frozen=True, slots=True)
class Handover:
    """Where the top of the tree takes over from a task: the vertices (b,) of its update."""

    border: Indices


@dataclass(frozen=True, slots=True)
class EliminationPiece:
    """Steps of one task, or of the top of the tree. Its vertices are numbered 0 to k - 1, its border k to k + b - 1."""

    vertices: Indices  # (k,) numbers in the matrix, ascending
    border: Indices  # (b,) numbers in the matrix, ascending, after all vertices
    edges: Indices  # (m,) numbers in the matrix
    steps: tuple[Front | Handover, ...]


@dataclass(frozen=True, slots=True)
class EliminationPlan:
    """Subtrees, each a task that depends on no other, and the top of the tree above them all."""

    tasks: tuple[EliminationPiece, ...]
    top: EliminationPiece


def planned(tree: Separator, sizes: Sequence[int], edges: IndexPairsNx2) -> EliminationPlan:
    """Plan for a matrix whose vertices are numbered in the tree's order, so many (`sizes`) for each of its separators.

    Edges (e, 2) are sorted, the earlier vertex first in each. Sums are the same in the same order whatever the tasks are.
    """
    nodes = _nodes(tree, sizes, edges)
    most = TASK_VERTICES if sum(sizes) > WHOLE_VERTICES else 0
    tasks, top = list[EliminationPiece](), list[_Node | Handover]()
    for end, node in enumerate(nodes):
        top.append(node)
        if node.subtree <= most < nodes[node.above].subtree:
            tasks.append(_piece(nodes[node.start : end + 1], edges))
            top[len(top) - (end + 1 - node.start) :] = [Handover(node.border)]
    return EliminationPlan(tuple(tasks), _piece(top, edges))


@dataclass(slots=True)
class _Node:
    """A front with numbers of the whole matrix; its subtree begins with node `start` and has so many vertices."""

    first: int
    last: int
    border: Indices
    edges: slice
    below: int
    start: int
    subtree: int
    above: int = -1  # number of the node that takes its update over

    @property
    def own(self) -> int:
        return self.last - self.first


def _nodes(tree: Separator, sizes: Sequence[int], edges: IndexPairsNx2) -> list[_Node]:
    """All fronts, those below first."""
    bounds = np.concatenate([[0], np.cumsum(sizes)]).tolist()
    begins = np.searchsorted(edges[:, 0], bounds).tolist()
    nodes, waiting = list[_Node](), list[int]()
    for number, part in enumerate(tree.in_order()):
        below = [waiting.pop() for _ in part.below][::-1]
        some = slice(begins[number], begins[number + 1])
        reached = np.unique(np.concatenate([edges[some, 1], *(nodes[lower].border for lower in below)]))
        node = _Node(
            first=bounds[number],
            last=bounds[number + 1],
            border=reached[reached >= bounds[number + 1]],
            edges=some,
            below=len(below),
            start=nodes[below[0]].start if below else number,
            subtree=sizes[number] + sum(nodes[lower].subtree for lower in below),
        )
        for lower in below:
            nodes[lower].above = number
        nodes.append(node)
        waiting.append(number)
    return nodes


def _piece(steps: Sequence[_Node | Handover], edges: IndexPairsNx2) -> EliminationPiece:
    """The steps with numbers of their own."""
    nodes = [step for step in steps if isinstance(step, _Node)]
    vertices = np.concatenate([np.arange(node.first, node.last) for node in nodes])
    border = nodes[-1].border
    numbered = np.concatenate([vertices, border])
    found, vertex, edge = list[Front | Handover](), 0, 0
    for step in steps:
        if isinstance(step, Handover):
            found.append(Handover(np.searchsorted(numbered, step.border)))
            continue
        last, stop = vertex + step.own, edge + step.edges.stop - step.edges.start
        later = np.searchsorted(numbered, step.border)
        ends = np.searchsorted(np.concatenate([np.arange(step.first, step.last), step.border]), edges[step.edges])
        found.append(Front(vertex, last, later, slice(edge, stop), ends, step.below))
        vertex, edge = last, stop
    chosen = np.concatenate([np.arange(node.edges.start, node.edges.stop) for node in nodes])
    return EliminationPiece(vertices, border, chosen, tuple(found))
