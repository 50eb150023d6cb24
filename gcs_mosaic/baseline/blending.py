"""Section III.D: alpha blending by the distance to the own border, the new frame heavier where its edges are dense."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.uint8]
Weights = NDArray[np.float32]

CANNY = 100, 200  # grey levels of gradient between which an edge goes on, and above which it begins; the usual pair
CLOSING = 5  # px; the twigs of one tree become one patch
BOOST = 2.0  # the new frame weighs so many times more where edges are dense; the paper gives no number


def blend(shown: Image, shown_weight: Weights, new: Image, new_coverage: Image) -> Image:
    """Both pictures (h, w, 3) as one.

    shown_weight (h, w): distance from the mosaic's border, 0 where it shows nothing; new_coverage (h, w): 0 or 255.
    """
    new_weight = border_distance(new_coverage) * edge_boost(new)
    share = new_weight / np.maximum(shown_weight + new_weight, 1e-6)
    mixed = cv2.blendLinear(new, shown, share, 1 - share)
    return np.asarray(np.where(new_coverage[..., None] > 0, mixed, shown), dtype=np.uint8)


def border_distance(coverage: Image) -> Weights:
    """Pixels from each covered place (h, w) to the nearest that is not; all around the picture nothing is."""
    framed = cv2.copyMakeBorder(coverage, 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=0)
    return np.asarray(cv2.distanceTransform(framed, cv2.DIST_L2, 5)[1:-1, 1:-1], dtype=np.float32)


def edge_boost(image: Image) -> Weights:
    """`BOOST` (h, w) where edges (Canny), closed (a dilation, then an erosion), cover the picture, else 1."""
    edges = cv2.Canny(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), *CANNY)
    closed = cv2.morphologyEx(edges, cv2.MORPH_CLOSE, np.ones((CLOSING, CLOSING), np.uint8))
    return np.where(closed > 0, np.float32(BOOST), np.float32(1))
