"""Exact brute-force matching as one matrix product: mutual nearest neighbours that pass the ratio test."""

from __future__ import annotations

import numpy as np

from gcs_mosaic.stitch.arrays import Descriptors, FloatRows, IndexPairsNx2, Indices, Vector32

BLOCK = 256  # descriptors compared with all others at a time: the full matrix would not fit into the cache


def match(descriptors_a: Descriptors, descriptors_b: Descriptors, ratio: float) -> IndexPairsNx2:
    """Index pairs (m, 2) of descriptors (n, d) and (k, d) that are each other's nearest neighbour in Euclidean distance.

    ratio: maximum ratio of the distances to the nearest and the second-nearest neighbour.
    """
    if len(descriptors_a) < 2 or len(descriptors_b) < 2:
        return np.empty((0, 2), np.intp)
    a, b = descriptors_a.astype(np.float32), descriptors_b.astype(np.float32)
    half_a, half_b = ((of * of).sum(axis=1) / 2 for of in (a, b))
    best, distance, second = _nearest_two(a, half_a, b, half_b)
    good = np.flatnonzero(distance < ratio**2 * second)
    # Mutuality is checked only for matches that pass the ratio test, which most do not.
    back, _, _ = _nearest_two(b[best[good]], half_b[best[good]], a, half_a)
    mutual = good[back == good]
    return np.column_stack([mutual, best[mutual]])


def _nearest_two(a: FloatRows, half_a: Vector32, b: FloatRows, half_b: Vector32) -> tuple[Indices, Vector32, Vector32]:
    """For each row of a (n, d): the nearest row of b (k, d), half its squared distance, and that of the second nearest, (n,)
    each. `half_a`, `half_b`: half the squared lengths.

    |a - b|^2 / 2 = |a|^2 / 2 - likeness with likeness = a b - |b|^2 / 2, whose last term is one more column.
    """
    wide_a = np.column_stack([a, np.ones(len(a), np.float32)])
    wide_b = np.column_stack([b, -half_b]).T
    best, distance, second = np.empty(len(a), np.intp), np.empty_like(half_a), np.empty_like(half_a)
    room = np.empty((min(BLOCK, len(a)), len(b)), np.float32)
    for first in range(0, len(a), BLOCK):
        some = slice(first, first + BLOCK)
        likeness = np.matmul(wide_a[some], wide_b, out=room[: len(a) - first])
        rows, nearest = np.arange(len(likeness)), likeness.argmax(axis=1)
        best[some], distance[some] = nearest, half_a[some] - likeness[rows, nearest]
        likeness[rows, nearest] = -np.inf
        second[some] = half_a[some] - likeness.max(axis=1)
    return best, distance, second
