"""Section III.D: alpha blending by distance to the border, with more weight for the new frame where its edges are dense."""

from __future__ import annotations

import cv2
import numpy as np

from gcs_mosaic.stitch.arrays import Coverage, FloatImage, ImageBGR

CANNY = 100, 200  # gradient in grey levels: lower and upper hysteresis threshold; the usual pair
CLOSING = 5  # px; the twigs of one tree become one blob
BOOST = 2.0  # factor on the new frame's weight where edges are dense; the paper gives no value


def blend(shown: ImageBGR, shown_weight: FloatImage, new: ImageBGR, new_coverage: Coverage) -> ImageBGR:
    """Blend two images (h, w, 3).

    shown_weight (h, w): distance from the mosaic's border, 0 where it is empty; new_coverage (h, w): 0 or 255.
    """
    new_weight = border_distance(new_coverage) * edge_boost(new)
    share = new_weight / np.maximum(shown_weight + new_weight, 1e-6)
    mixed = cv2.blendLinear(new, shown, share, 1 - share)
    return np.asarray(np.where(new_coverage[..., None] > 0, mixed, shown), dtype=np.uint8)


def border_distance(coverage: Coverage) -> FloatImage:
    """Distance in pixels from each covered pixel (h, w) to the nearest uncovered one; outside the image all are uncovered."""
    framed = cv2.copyMakeBorder(coverage, 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=0)
    return np.asarray(cv2.distanceTransform(framed, cv2.DIST_L2, 5)[1:-1, 1:-1], dtype=np.float32)


def edge_boost(image: ImageBGR) -> FloatImage:
    """`BOOST` (h, w) where closed edges (Canny, then dilation and erosion) cover the image, else 1."""
    edges = cv2.Canny(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), *CANNY)
    closed = cv2.morphologyEx(edges, cv2.MORPH_CLOSE, np.ones((CLOSING, CLOSING), np.uint8))
    return np.where(closed > 0, np.float32(BOOST), np.float32(1))
