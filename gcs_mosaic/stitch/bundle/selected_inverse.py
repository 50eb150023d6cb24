"""Covariances of single frames from a sparse normal matrix: the selected inverse.

Only the diagonal blocks of the inverse are needed, and they depend only on blocks where the factorisation has entries
(Takahashi's equations: Erisman & Tinney, CACM 18(3), 1975; Rue & Martino, J. Stat. Plan. Inference 137, 2007). Block-wise as in
Lin et al. (SelInv, ACM TOMS 37(4), 2011): frames are ordered by nested dissection (George, SIAM J. Numer. Anal. 10(2), 1973),
here with straight cuts of the map, so that the factorisation is a tree of small dense fronts (Duff & Reid, ACM TOMS 9(3),
1983). Going up the tree eliminates, going down inverts.

Unknowns common to all frames, the lenses, are eliminated last: they are in the border of every front.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from scipy import linalg, sparse

from gcs_mosaic.stitch.arrays import Indices, Matrices, Matrix, PointsNx2, SquareMatrix

LEAF_FRAMES = 24  # frames eliminated together; half and twice as many take as long


@dataclass(frozen=True, slots=True)
class Covariances:
    """Selected inverse for n frames with u unknowns each and l unknowns common to all."""

    of_frames: Matrices  # (n, u, u)
    with_common: Matrices  # (n, u, l)
    of_common: SquareMatrix  # (l, l)


def covariances(
    normal: sparse.csc_matrix, frame_unknowns: int, places: PointsNx2, known: Indices
) -> Covariances | None:
    """Diagonal blocks of the inverse of a normal matrix with u unknowns per frame, followed by those common to all.

    `places` (n, 2): positions of the frames, only for the elimination order. `known` (k,): unknowns taken as exact; their
    covariances are zero. None if the matrix is singular.
    """
    frames, size = len(places), normal.shape[0]
    common = size - frame_unknowns * frames
    uncertain = np.ones(size, bool)
    uncertain[known] = False
    scale = np.where(uncertain, 1 / np.sqrt(np.maximum(normal.diagonal(), 1e-300)), 0.0)
    scaling = sparse.diags(scale)
    # A known unknown is decoupled from the others; a unit diagonal keeps the matrix regular.
    scaled = (scaling @ normal @ scaling + sparse.diags(np.where(uncertain, 0.0, 1.0))).tocsr()
    tree = _dissected(_frame_graph(normal, frame_unknowns, frames), places)
    order = np.concatenate([part.frames for part in tree.in_order()])
    unknowns = (order[:, None] * frame_unknowns + np.arange(frame_unknowns)).ravel()
    permutation = np.concatenate([unknowns, np.arange(size - common, size)])
    try:
        found = _selected(scaled[permutation][:, permutation].tocsc(), tree, frame_unknowns, common)
    except np.linalg.LinAlgError:
        return None
    position = np.empty(frames, np.intp)
    position[order] = np.arange(frames)
    by_frame = np.where(uncertain, scale, 0.0)[: size - common].reshape(frames, frame_unknowns)
    of_common = scale[size - common :]
    return Covariances(
        found.of_frames[position] * by_frame[:, :, None] * by_frame[:, None, :],
        found.with_common[position] * by_frame[:, :, None] * of_common,
        found.of_common * of_common[:, None] * of_common,
    )


@dataclass(slots=True)
class _Part:
    """A node of the elimination tree: frames eliminated together, after those of all nodes below."""

    frames: Indices
    below: list[_Part] = field(default_factory=list)

    def in_order(self) -> Iterator[_Part]:
        """The nodes in elimination order: children first."""
        for part in self.below:
            yield from part.in_order()
        yield self


def _frame_graph(normal: sparse.csc_matrix, frame_unknowns: int, frames: int) -> sparse.csr_matrix:
    """Adjacency of the frames (n, n): which have entries in common."""
    entries = normal[: frames * frame_unknowns, : frames * frame_unknowns].tocoo()
    linked = (np.ones(entries.nnz, np.int32), (entries.row // frame_unknowns, entries.col // frame_unknowns))
    return sparse.coo_matrix(linked, shape=(frames, frames)).tocsr()


def _dissected(graph: sparse.csr_matrix, places: PointsNx2) -> _Part:
    """Nested dissection: halve the map across its longer side, separate the frames that connect the halves, recurse."""

    def cut(frames: Indices) -> _Part:
        if len(frames) <= LEAF_FRAMES:
            return _Part(frames)
        axis = int(np.argmax(np.ptp(places[frames], axis=0)))
        order = frames[np.argsort(places[frames, axis], kind="stable")]
        halves = order[: len(order) // 2], order[len(order) // 2 :]
        between = graph[halves[0]][:, halves[1]]
        touching = np.diff(between.indptr) > 0, np.bincount(between.indices, minlength=len(halves[1])) > 0
        side = int(touching[1].sum() < touching[0].sum())
        apart, rest = halves[side][touching[side]], halves[side][~touching[side]]
        if not len(rest):  # everything overlaps everything: no order is better than another
            return _Part(frames)
        return _Part(apart, [cut(rest), cut(halves[1 - side])])

    return cut(np.arange(len(places)))


@dataclass(slots=True)
class _Front:
    """One elimination step: own unknowns (o,), and the later ones (b,) that depend on them."""

    own: Indices
    border: Indices
    inverse: SquareMatrix  # (o, o), of the own block
    gain: Matrix  # (o, b): own block inverse times border block
    below: list[_Front]
    update: SquareMatrix | None  # (b, b): Schur complement added to the border, until the parent front takes it


def _selected(matrix: sparse.csc_matrix, tree: _Part, frame_unknowns: int, common: int) -> Covariances:
    """Selected inverse of a matrix in the tree's order."""
    frames = (matrix.shape[0] - common) // frame_unknowns
    root = _eliminated(matrix, tree, frame_unknowns, common)
    found = Covariances(
        np.empty((frames, frame_unknowns, frame_unknowns)),
        np.empty((frames, frame_unknowns, common)),
        np.empty((common, common)),
    )
    found.of_common[:] = root.inverse[len(root.own) - common :, len(root.own) - common :]
    _invert(root, np.empty((0, 0)), found)
    return found


def _eliminated(matrix: sparse.csc_matrix, tree: _Part, frame_unknowns: int, common: int) -> _Front:
    """Eliminate up the tree. The common unknowns belong to its root."""
    size, first = matrix.shape[0], 0
    of_all = np.arange(size - common, size)

    def up(part: _Part) -> _Front:
        nonlocal first
        below = [up(lower) for lower in part.below]
        own, before = np.arange(first, first + frame_unknowns * len(part.frames)), first
        first += len(own)
        if part is tree:
            own = np.concatenate([own, of_all])
        return _front(matrix, own, before, of_all, below)

    return up(tree)


def _front(matrix: sparse.csc_matrix, own: Indices, first: int, common: Indices, below: list[_Front]) -> _Front:
    """Eliminate `own`, the unknowns from `first` on; empty where two halves of the map have no link across their cut."""
    columns = matrix[:, own]
    reached = np.concatenate([columns.indices, common, *(front.border for front in below)])
    border = np.setdiff1d(reached[reached >= first], own)
    unknowns = np.concatenate([own, border])
    dense = np.zeros((len(unknowns), len(unknowns)))
    dense[:, : len(own)] = columns[unknowns].toarray()
    dense[: len(own), len(own) :] = dense[len(own) :, : len(own)].T
    for front in below:
        at = np.searchsorted(unknowns, front.border)
        assert front.update is not None
        dense[np.ix_(at, at)] += front.update
        front.update = None
    o = len(own)
    # A cut that nothing overlaps has no unknowns of its own; older scipy cannot solve empty systems.
    inverse = linalg.cho_solve(linalg.cho_factor(dense[:o, :o]), np.eye(o)) if o else np.zeros((0, 0))
    gain = inverse @ dense[:o, o:]
    return _Front(own, border, inverse, gain, below, dense[o:, o:] - dense[o:, :o] @ gain)


def _invert(front: _Front, of_border: SquareMatrix, found: Covariances) -> None:
    """Invert down the tree from a front whose border block of the inverse (b, b) is known."""
    own, o = front.own, len(front.own)
    whole = np.empty((o + len(front.border),) * 2)
    whole[o:, o:] = of_border
    whole[:o, o:] = -front.gain @ of_border
    whole[o:, :o] = whole[:o, o:].T
    whole[:o, :o] = front.inverse - whole[:o, o:] @ front.gain.T
    u, common = found.with_common.shape[1:]
    frames = own[own < u * len(found.of_frames)].reshape(-1, u)
    for k, unknowns in enumerate(frames):
        found.of_frames[unknowns[0] // u] = whole[k * u : k * u + u, k * u : k * u + u]
        found.with_common[unknowns[0] // u] = whole[k * u : k * u + u, whole.shape[1] - common :]
    unknowns = np.concatenate([own, front.border])
    for lower in front.below:
        at = np.searchsorted(unknowns, lower.border)
        _invert(lower, whole[np.ix_(at, at)], found)
