"""How a new frame and what is already shown become one picture; modes are functions, chosen by name.

`edge` is the paper's: alpha blending by the distance to the frame's own border, where dense edges (Canny, then a
morphological closing) raise the new frame's weight. Portakal, Kındıroğlu, Uluyağmur Öztürk, "Real Time Incremental Image
Mosaicking Without Use of Any Camera Parameter", section III.D. Added here: where edges are dense, the blend is also steep,
so that such a place comes from one frame only.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.stitch.lattice import Lattice
from gcs_mosaic.stitch.layers import Layer, make_layer
from gcs_mosaic.stitch.warping import upscale

Image = NDArray[np.uint8]
Blend = Callable[[Layer, Layer, Lattice], Layer]
"""(what is shown, the new frame's part, density of the new frame's edges at the lattice points) -> what is shown now."""

EDGE_PIXELS = 750_000  # the size a frame is looked at for edges; finer edges are noise and grass
CANNY_LOW, CANNY_HIGH = 60, 150  # grey levels of gradient
CLOSING = 5  # px at that size
NEIGHBOURHOOD = 31  # px at that size over which edges are counted; about a tree
DENSE = 0.4  # share of pixels on closed edges that counts as wholly dense
BOOST = 2.0  # the new frame's weight counts so many times more where edges are dense
SOFT, STEEP = 1.5, 16.0  # exponents of the weights' ratio on smooth ground and where edges are dense
LEAST_WEIGHT = 1e-3  # keeps the ratio finite at borders


def edge_density(image: Image) -> NDArray[np.float32]:
    """How dense edges are around each place of a frame, 0 to 1, a quarter as wide as the ~0.75 MP picture it is told from."""
    shrink = min(1.0, math.sqrt(EDGE_PIXELS / (image.shape[0] * image.shape[1])))
    size = max(1, round(image.shape[1] * shrink)), max(1, round(image.shape[0] * shrink))
    grey = cv2.cvtColor(cv2.resize(image, size, interpolation=cv2.INTER_AREA), cv2.COLOR_BGR2GRAY)
    edges = cv2.Canny(grey, CANNY_LOW, CANNY_HIGH)
    closed = cv2.morphologyEx(edges, cv2.MORPH_CLOSE, np.ones((CLOSING, CLOSING), np.uint8))
    quarter = max(1, size[0] // 4), max(1, size[1] // 4)
    share = cv2.resize(cv2.blur(closed, (NEIGHBOURHOOD, NEIGHBOURHOOD)), quarter, interpolation=cv2.INTER_AREA)
    return np.asarray(np.minimum(share / (255 * DENSE), 1), dtype=np.float32)


def edge(shown: Layer, new: Layer, density: Lattice) -> Layer:
    """The paper's blend: soft on smooth ground, the heavier frame alone where the new frame's edges are dense."""
    boosted = np.maximum(new.weight, LEAST_WEIGHT) * (1 + (BOOST - 1) * density)
    steepness = SOFT + (STEEP - SOFT) * density
    log_ratio = steepness * np.log(boosted / np.maximum(shown.weight, LEAST_WEIGHT))
    return mix(shown, new, 1 / (1 + np.exp(-np.clip(log_ratio, -30, 30))))


def newest(shown: Layer, new: Layer, density: Lattice) -> Layer:
    """The new frame as it is."""
    return mix(shown, new, np.ones_like(density))


def first(shown: Layer, new: Layer, density: Lattice) -> Layer:
    """The new frame only where nothing is shown yet."""
    return mix(shown, new, np.zeros_like(density))


BLENDS: dict[str, Blend] = {"edge": edge, "newest": newest, "first": first}


def mix(shown: Layer, new: Layer, new_share: Lattice) -> Layer:
    """Both pictures by the new one's share at the lattice points; where only one covers, that one alone."""
    weight = np.maximum(shown.weight, new.weight)
    share = upscale(new_share.astype(np.float32))
    if not shown.is_full:
        share[shown.coverage == 0] = 1
    if not new.is_full:
        share[new.coverage == 0] = 0
    colour = np.asarray(cv2.blendLinear(new.colour, shown.colour, share, 1 - share), dtype=np.uint8)
    coverage = None if shown.is_full or new.is_full else np.maximum(shown.coverage, new.coverage)
    mixed = make_layer(colour, coverage, weight)
    assert mixed is not None, "two pictures that cover something cannot cover nothing together"
    return mixed
