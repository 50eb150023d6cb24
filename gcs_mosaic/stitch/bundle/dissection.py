"""Nested dissection: an order of elimination in which few new entries arise, and whose parts do not depend on each other.

A separator is a set of frames without which the others fall into two halves that no link connects. The halves are eliminated
first, each by itself, then the separator; each half is cut in the same way (George, SIAM J. Numer. Anal. 10(2), 1973). Places
only say where to look: between the outer parts of the map across one of four directions, the fewest frames that disconnect them
are found as a maximum flow on the links themselves (inertial flow: Schild & Sommer, SEA 2015).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import breadth_first_order, connected_components, maximum_flow

from gcs_mosaic.stitch.arrays import IndexPairsNx2, Indices, Mask, PointsNx2

LEAF_FRAMES = 24  # eliminated together: fewer are too small for dense arithmetic, more waste it on zeros
OUTER_SHARE = 0.4  # of the frames on either side, between which the separator is sought
LEAST_SHARE = 0.125  # of the frames in each half, below which nothing is gained by a cut
# Frames from which separators across all directions are compared; of fewer only the most promising is found.
COMPARED_FROM = 500
DIRECTIONS = np.array([[1.0, 0.0], [0.0, 1.0], [1.0, 1.0], [1.0, -1.0]])
ACROSS = (1, 0, 3, 2, 0)  # the one perpendicular to each


@dataclass(frozen=True, slots=True)
class Separator:
    """Frames eliminated together, after those of the parts `below`, which they separate; a leaf has none below."""

    frames: Indices
    below: tuple[Separator, ...] = ()

    def in_order(self) -> Iterator[Separator]:
        """The separators in order of elimination: those below first."""
        for part in self.below:
            yield from part.in_order()
        yield self


def dissected(links: IndexPairsNx2, places: PointsNx2) -> Separator:
    """Tree of separators of n frames at these places (n, 2), linked by pairs (m, 2); a pure function of both."""
    return _cut(np.arange(len(places)), links, places)


def _cut(frames: Indices, links: IndexPairsNx2, places: PointsNx2) -> Separator:
    """Tree of these frames (n,); links (m, 2) and places (n, 2) are theirs alone, numbered 0 to n - 1."""
    if len(frames) <= LEAF_FRAMES:
        return Separator(frames)
    graph = _graph(links, len(frames))
    found = _apart(graph) or _separated(links, graph, places)
    if found is None:
        return Separator(frames)
    own = found.along[~(found.low | found.high)[found.along]]
    return Separator(
        frames[own], tuple(_cut(frames[half], _within(half, links), places[half]) for half in (found.low, found.high))
    )


@dataclass(frozen=True, slots=True)
class _Halves:
    """Two sets of n frames that no link connects; the others separate them. `along` (n,): all frames, in an order in which the
    latter have their neighbours beside them, so that what is added to a front lies in few stretches of it."""

    low: Mask
    high: Mask
    along: Indices

    @property
    def price(self) -> float:
        """Frames that separate them, dearer the less equal the halves are."""
        low, high, n = int(self.low.sum()), int(self.high.sum()), len(self.low)
        return (n - low - high) * (1 + abs(low - high) / n) if min(low, high) >= LEAST_SHARE * n else math.inf


def _within(half: Mask, links: IndexPairsNx2) -> IndexPairsNx2:
    """Links between frames of one half (n,), renumbered."""
    number = np.cumsum(half) - 1
    return np.asarray(number[links[half[links].all(axis=1)]])


def _graph(links: IndexPairsNx2, n: int) -> sparse.csr_matrix:
    """Adjacency (n, n)."""
    rows, columns = np.concatenate([links, links[:, ::-1]]).T
    return sparse.csr_matrix((np.ones(len(rows), np.int8), (rows, columns)), shape=(n, n))


def _apart(graph: sparse.csr_matrix) -> _Halves | None:
    """Halves that nothing connects, as equal as it goes; None if all frames are connected."""
    count, label = connected_components(graph, directed=False)
    if count == 1:
        return None
    sizes = np.bincount(label)
    order = np.argsort(-sizes, kind="stable")
    first = order[np.cumsum(sizes[order]) <= max(len(label) // 2, sizes[order[0]])]
    one = np.isin(label, first)
    return _Halves(one, ~one, np.arange(len(label)))


def _separated(links: IndexPairsNx2, graph: sparse.csr_matrix, places: PointsNx2) -> _Halves | None:
    """Halves of connected frames; None where everything overlaps everything, so that no order is better than another."""
    n = len(places)
    orders = [*(np.argsort(places @ direction, kind="stable") for direction in DIRECTIONS), _order_by_links(graph)]
    ranks = [_inverse(order) for order in orders]
    crossing = [int(((rank[links[:, 0]] < n // 2) != (rank[links[:, 1]] < n // 2)).sum()) for rank in ranks]
    promising = np.argsort(crossing, kind="stable")[: None if n >= COMPARED_FROM else 1].tolist()
    outer = int(OUTER_SHARE * n)
    cuts = [
        _Halves(*_least_vertex_cut(links, ranks[way] < outer, ranks[way] >= n - outer), orders[ACROSS[way]])
        for way in promising
    ]
    best = min(cuts, key=lambda cut: cut.price)
    return best if math.isfinite(best.price) else None


def _inverse(order: Indices) -> Indices:
    rank = np.empty(len(order), np.intp)
    rank[order] = np.arange(len(order))
    return rank


def _order_by_links(graph: sparse.csr_matrix) -> Indices:
    """Connected frames by their distance in links from one at the edge of the map: right though places may be wrong."""
    far = breadth_first_order(graph, 0, return_predecessors=False)[-1]
    return np.asarray(breadth_first_order(graph, far, return_predecessors=False), dtype=np.intp)


def _least_vertex_cut(links: IndexPairsNx2, low: Mask, high: Mask) -> tuple[Mask, Mask]:
    """The frames (n,) on the side of `low` and on that of `high` once the fewest frames are taken out that connect them.

    By Menger's theorem a maximum flow through frames of capacity one. Frames that have links with their own side only, or with
    frames that a cut never reaches, are left out of it.
    """
    n = len(low)
    ends = np.concatenate([links, links[:, ::-1]])
    ends = ends[~(low[ends[:, 1]] | high[ends[:, 0]])]  # the flow never turns back
    used = ~(low | high)
    used[ends.ravel()] = True
    number = np.cumsum(used) - 1
    entry, leave = 2 * number, 2 * number + 1
    m, at = int(used.sum()), np.flatnonzero(used)
    source, sink = np.full(int((used & low).sum()), 2 * m), np.full(int((used & high).sum()), 2 * m + 1)
    rows = np.concatenate([entry[at], leave[ends[:, 0]], source, leave[used & high]])
    columns = np.concatenate([leave[at], entry[ends[:, 1]], entry[used & low], sink])
    capacity = np.full(len(rows), n + 1, np.int32)
    capacity[:m] = 1
    network = sparse.csr_matrix((capacity, (rows, columns)), shape=(2 * m + 2, 2 * m + 2))
    residual = network - maximum_flow(network, 2 * m, 2 * m + 1).flow
    residual.eliminate_zeros()
    reached = np.zeros(2 * m + 2, bool)
    reached[breadth_first_order(residual, 2 * m, return_predecessors=False)] = True
    near, separates = low.copy(), np.zeros(n, bool)
    near[at] = reached[leave[at]]
    separates[at] = reached[entry[at]] & ~reached[leave[at]]
    return near & ~separates, ~near & ~separates
