"""Separators separate, are as small as they can be, and leave a factor with few entries."""

from itertools import combinations

import numpy as np
import pytest
from linked_frames import all_of, shapes
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from gcs_mosaic.stitch.arrays import IndexPairsNx2, Indices, Mask
from gcs_mosaic.stitch.bundle.dissection import LEAF_FRAMES, Separator, _least_vertex_cut, dissected
from tests.benchmarks.survey_of_matches import survey

SHAPES = shapes()


@pytest.mark.parametrize("shape", SHAPES)
def test_no_link_connects_what_a_separator_keeps_apart(shape: str) -> None:
    links, places = SHAPES[shape]
    tree = dissected(links, places)
    frames = np.concatenate([part.frames for part in tree.in_order()])
    assert sorted(frames.tolist()) == list(range(len(places)))
    for part in tree.in_order():
        sides = [np.concatenate([lower.frames for lower in one.in_order()]) for one in part.below]
        for side, other in combinations(sides, 2):
            assert not (np.isin(links, side).any(axis=1) & np.isin(links, other).any(axis=1)).any()


@pytest.mark.parametrize("shape", ["a survey", "a survey with wrong places", "a chain with wrong places", "a star"])
def test_fronts_stay_small(shape: str) -> None:
    assert max(len(part.frames) for part in dissected(*SHAPES[shape]).in_order()) <= 1.5 * LEAF_FRAMES


def test_the_factor_of_a_flight_is_not_much_larger_than_by_minimum_degree() -> None:
    """With dense fronts, which hold some zeros, against single frames in the order that SuperLU chooses."""
    problem = survey(1000).problem
    found = entries(dissected(problem.pairs, problem.poses[:, :2]), problem.pairs)
    assert found < 1.7 * entries_by_minimum_degree(problem.pairs, 1000)


def entries(tree: Separator, links: IndexPairsNx2) -> int:
    """Of the lower triangle of the factor, one for each frame."""
    parts, borders, total = list(tree.in_order()), dict[int, set[int]](), 0
    place = {frame: number for number, part in enumerate(parts) for frame in part.frames.tolist()}
    linked: dict[int, set[int]] = {frame: set() for frame in place}
    for a, b in links.tolist():
        linked[a].add(b)
        linked[b].add(a)
    for number, part in enumerate(parts):
        own = part.frames.tolist()
        reached = set[int]().union(*(linked[frame] for frame in own), *(borders.pop(id(lower)) for lower in part.below))
        borders[id(part)] = {frame for frame in reached if place[frame] > number}
        total += len(own) * (len(own) + 1) // 2 + len(own) * len(borders[id(part)])
    return total


def entries_by_minimum_degree(links: IndexPairsNx2, frames: int) -> int:
    half = sparse.coo_matrix((np.ones(len(links)), tuple(links.T)), shape=(frames, frames))
    matrix = (half + half.T + 100 * sparse.identity(frames)).tocsc()
    factor = splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    return int(factor.L.nnz)


def test_no_smaller_separator_would_do() -> None:
    """Of small random graphs all sets of frames are tried."""
    rng = np.random.default_rng(2)
    for _ in range(100):
        n = int(rng.integers(5, 10))
        links = all_of(n)[rng.random(n * (n - 1) // 2) < rng.uniform(0.1, 0.7)]
        low, high = np.arange(n) < n // 3, np.arange(n) >= n - n // 3
        one, other = _least_vertex_cut(links, low, high)
        taken = np.flatnonzero(~one & ~other)
        assert not (one & other).any()
        assert separates(taken, links, low, high)
        if len(taken):
            fewer = combinations(range(n), len(taken) - 1)
            assert not any(separates(np.array(some, np.intp), links, low, high) for some in fewer)


def separates(taken: Indices, links: IndexPairsNx2, low: Mask, high: Mask) -> bool:
    """Whether no way leads from low to high but through these frames."""
    kept = links[~np.isin(links, taken).any(axis=1)]
    _, label = connected_components(sparse.coo_matrix((np.ones(len(kept)), tuple(kept.T)), shape=(len(low),) * 2))
    left = ~np.isin(np.arange(len(low)), taken)
    return not set(label[low & left].tolist()) & set(label[high & left].tolist())
