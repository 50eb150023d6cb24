"""The paper's blend: alpha blending by the distance to each frame's own border, and less of it where edges are dense.

Dense edges (Canny, then a morphological closing) raise the new frame's weight. Portakal, Kındıroğlu, Uluyağmur Öztürk, "Real
Time Incremental Image Mosaicking Without Use of Any Camera Parameter", section III.D. Added here: where edges are dense, the
blend is also steep, so that such a place comes from one frame only.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.stitch.painting.blending import LEAST_WEIGHT, Part, laid_over
from gcs_mosaic.stitch.painting.layers import Layer
from gcs_mosaic.stitch.painting.warping import shrunk

Image = NDArray[np.uint8]

EDGE_PIXELS = 750_000  # the size a frame is looked at for edges; finer edges are noise and grass
STRONGEST = (
    0.1  # share of a frame's pixels whose gradient may begin an edge: the light differs too much for fixed bounds
)
LEAST_GRADIENT = 24  # of Sobel's operator, grey levels; below it is the noise of flat ground
CLOSING = 5  # px at that size
NEIGHBOURHOOD = 31  # px at that size over which edges are counted; about a tree
DENSE = 0.4  # share of pixels on closed edges that counts as wholly dense
BOOST = 1.3  # the new frame's weight counts so many times more where edges are dense
SOFT, STEEP = 4.0, 32.0  # exponents of the weights' ratio on smooth ground and where edges are dense


def edge_density(look: Image) -> NDArray[np.float32]:
    """How dense edges are around each place of a frame, 0 to 1, (h, w, 1), a quarter as wide as the ~0.75 MP picture it is
    told from."""
    small = shrunk(look, EDGE_PIXELS)
    size = small.shape[1], small.shape[0]
    grey = cv2.cvtColor(small, cv2.COLOR_BGR2GRAY)
    edges = _edges(np.asarray(grey, dtype=np.uint8))
    closed = cv2.morphologyEx(edges, cv2.MORPH_CLOSE, np.ones((CLOSING, CLOSING), np.uint8))
    quarter = max(1, size[0] // 4), max(1, size[1] // 4)
    share = cv2.resize(cv2.blur(closed, (NEIGHBOURHOOD, NEIGHBOURHOOD)), quarter, interpolation=cv2.INTER_AREA)
    return np.asarray(np.minimum(share / (255 * DENSE), 1), dtype=np.float32)[..., None]


def _edges(grey: Image) -> Image:
    dx, dy = cv2.Sobel(grey, cv2.CV_16S, 1, 0), cv2.Sobel(grey, cv2.CV_16S, 0, 1)
    some = np.abs(dx[::4, ::4]).astype(np.int32) + np.abs(dy[::4, ::4])
    high = max(float(np.quantile(some, 1 - STRONGEST)), LEAST_GRADIENT)
    return np.asarray(cv2.Canny(dx, dy, high / 2.5, high), dtype=np.uint8)


def edge(shown: Layer, new: Part) -> Layer:
    """The paper's blend: soft on smooth ground, the heavier frame alone where the new frame's edges are dense."""
    density = new.measured[::2, ::2, 0].astype(np.float32)
    boosted = np.maximum(new.weight, LEAST_WEIGHT) * (1 + (BOOST - 1) * density)
    steepness = SOFT + (STEEP - SOFT) * density
    log_ratio = steepness * np.log(boosted / np.maximum(shown.weight, LEAST_WEIGHT))
    return laid_over(shown, new, 1 / (1 + np.exp(-np.clip(log_ratio, -30, 30))))
