"""Exact brute-force matching as one matrix product: mutual nearest neighbours that pass the ratio test."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

RATIO = 0.85  # of the distances to the best and second-best match; RANSAC follows, so a loose test loses nothing


def match(descriptors_a: NDArray[np.uint8], descriptors_b: NDArray[np.uint8], ratio: float = RATIO) -> NDArray[np.intp]:
    """Index pairs (m, 2) of descriptors (n, d) and (k, d) that are each other's nearest, by Euclidean distance."""
    if len(descriptors_a) < 2 or len(descriptors_b) < 2:
        return np.empty((0, 2), np.intp)
    a, b = descriptors_a.astype(np.float32), descriptors_b.astype(np.float32)
    # |a - b|^2 / 2 without |a|^2 / 2, which is the same along a row: its order is the order of the distances.
    likeness = a @ b.T
    likeness -= (b * b).sum(axis=1) / 2
    rows = np.arange(len(a))
    best = likeness.argmax(axis=1)
    likeness_of_best = likeness[rows, best]
    mutual = (likeness - (a * a).sum(axis=1, keepdims=True) / 2).argmax(axis=0)[best] == rows
    likeness[rows, best] = -np.inf
    half_norm = (a * a).sum(axis=1) / 2
    distance, second = half_norm - likeness_of_best, half_norm - likeness.max(axis=1)
    good = mutual & (distance < ratio**2 * second)
    return np.column_stack([rows[good], best[good]])
