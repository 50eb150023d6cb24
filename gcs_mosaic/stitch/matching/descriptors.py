"""Exact brute-force matching as one matrix product: mutual nearest neighbours that pass the ratio test."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.stitch.matching.features import Descriptors


def match(descriptors_a: Descriptors, descriptors_b: Descriptors, ratio: float) -> NDArray[np.intp]:
    """Index pairs (m, 2) of descriptors (n, d) and (k, d) that are each other's nearest, by Euclidean distance.

    ratio: of the distances to the best and second-best match, below which a match is kept.
    """
    if len(descriptors_a) < 2 or len(descriptors_b) < 2:
        return np.empty((0, 2), np.intp)
    a, b = descriptors_a.astype(np.float32), descriptors_b.astype(np.float32)
    half_a, half_b = (a * a).sum(axis=1) / 2, (b * b).sum(axis=1) / 2
    # |a - b|^2 / 2 without |a|^2 / 2, which is the same along a row: its order is the order of the distances.
    likeness = a @ b.T - half_b
    rows = np.arange(len(a))
    best = likeness.argmax(axis=1)
    distance = half_a - likeness[rows, best]
    likeness[rows, best] = -np.inf
    good = np.flatnonzero(distance < ratio**2 * (half_a - likeness.max(axis=1)))
    # Looking back is asked only of what has passed the ratio test, which most have not.
    mutual = good[(b[best[good]] @ a.T - half_a).argmax(axis=1) == good]
    return np.column_stack([mutual, best[mutual]])
