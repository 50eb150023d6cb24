"""Section III.B: brute-force matching with the ratio test."""

from __future__ import annotations

import cv2
import numpy as np

from gcs_mosaic.stitch.arrays import Descriptors, IndexPairsNx2


def ratio_matches(frame: Descriptors, region: Descriptors, ratio: float) -> IndexPairsNx2:
    """Index pairs (m, 2) of descriptors (n, d) and (k, d) as the detector returns them.

    ratio: maximum ratio of the distances to the nearest and the second-nearest descriptor of the region.
    """
    if not len(frame) or len(region) < 2:
        return np.empty((0, 2), np.intp)
    norm = cv2.NORM_HAMMING if frame.dtype == np.uint8 else cv2.NORM_L2
    pairs = cv2.BFMatcher.create(norm).knnMatch(frame, region, k=2)
    kept = [(best.queryIdx, best.trainIdx) for best, second in pairs if best.distance < ratio * second.distance]
    return np.array(kept, dtype=np.intp).reshape(-1, 2)
