"""How a new frame and what is already shown become one picture; modes are functions, chosen by name.

`edge` is the paper's: alpha blending by the distance to the frame's own border, where dense edges (Canny, then a
morphological closing) raise the new frame's weight. Portakal, Kındıroğlu, Uluyağmur Öztürk, "Real Time Incremental Image
Mosaicking Without Use of Any Camera Parameter", section III.D. Added here: where edges are dense, the blend is also steep,
so that such a place comes from one frame only.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.stitch.bands import Bands
from gcs_mosaic.stitch.painting.lattice import Lattice
from gcs_mosaic.stitch.painting.layers import Layer, make_layer
from gcs_mosaic.stitch.painting.warping import upscale

Image = NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class NewPart:
    """What a new frame brings to a tile: its weight and the density of its edges at the lattice points, and its picture,
    which costs a warp to look at; None if it turns out to cover nothing."""

    weight: Lattice
    density: Lattice
    picture: Callable[[], Layer | None]


Blend = Callable[[Layer, NewPart], Layer]
"""(what a tile shows, what a new frame brings) -> what it shows now."""

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
LEAST_WEIGHT = 1e-3  # keeps the ratio finite at borders


def edge_density(image: Image) -> NDArray[np.float32]:
    """How dense edges are around each place of a frame, 0 to 1, a quarter as wide as the ~0.75 MP picture it is told from."""
    shrink = min(1.0, math.sqrt(EDGE_PIXELS / (image.shape[0] * image.shape[1])))
    size = max(1, round(image.shape[1] * shrink)), max(1, round(image.shape[0] * shrink))
    grey = cv2.cvtColor(cv2.resize(image, size, interpolation=cv2.INTER_AREA), cv2.COLOR_BGR2GRAY)
    edges = _edges(np.asarray(grey, dtype=np.uint8))
    closed = cv2.morphologyEx(edges, cv2.MORPH_CLOSE, np.ones((CLOSING, CLOSING), np.uint8))
    quarter = max(1, size[0] // 4), max(1, size[1] // 4)
    share = cv2.resize(cv2.blur(closed, (NEIGHBOURHOOD, NEIGHBOURHOOD)), quarter, interpolation=cv2.INTER_AREA)
    return np.asarray(np.minimum(share / (255 * DENSE), 1), dtype=np.float32)


def _edges(grey: Image) -> Image:
    dx, dy = cv2.Sobel(grey, cv2.CV_16S, 1, 0), cv2.Sobel(grey, cv2.CV_16S, 0, 1)
    some = np.abs(dx[::4, ::4]).astype(np.int32) + np.abs(dy[::4, ::4])
    high = max(float(np.quantile(some, 1 - STRONGEST)), LEAST_GRADIENT)
    return np.asarray(cv2.Canny(dx, dy, high / 2.5, high), dtype=np.uint8)


def edge(shown: Layer, new: NewPart) -> Layer:
    """The paper's blend: soft on smooth ground, the heavier frame alone where the new frame's edges are dense."""
    boosted = np.maximum(new.weight, LEAST_WEIGHT) * (1 + (BOOST - 1) * new.density)
    steepness = SOFT + (STEEP - SOFT) * new.density
    log_ratio = steepness * np.log(boosted / np.maximum(shown.weight, LEAST_WEIGHT))
    return laid_over(shown, new, 1 / (1 + np.exp(-np.clip(log_ratio, -30, 30))))


def newest(shown: Layer, new: NewPart) -> Layer:
    """The new frame as it is."""
    return laid_over(shown, new, np.ones_like(new.weight))


def first(shown: Layer, new: NewPart) -> Layer:
    """The new frame only where nothing is shown yet."""
    return laid_over(shown, new, np.zeros_like(new.weight))


BLENDS: dict[str, Blend] = {"edge": edge, "newest": newest, "first": first}


def laid_over(shown: Layer, new: NewPart, new_share: Lattice) -> Layer:
    """The new part in its share (0 to 1, at the lattice points), warped only if that makes a difference."""
    if shown.is_full and float(new_share.max()) < 0.5 / 255:
        return replace(shown, weight=np.maximum(shown.weight, new.weight))
    picture = new.picture()
    return shown if picture is None else mix(shown, picture, new_share)


def mix(shown: Layer, new: Layer, new_share: Lattice) -> Layer:
    """Both pictures by the new one's share (0 to 1) at the lattice points; where only one covers, that one alone."""
    share = upscale(np.rint(new_share * 255).astype(np.float32)).astype(np.uint8)
    if not shown.is_full:
        share[shown.coverage == 0] = 255
    if not new.is_full:
        share[new.coverage == 0] = 0
    coverage = None if shown.is_full or new.is_full else np.maximum(shown.coverage, new.coverage)
    weight = np.maximum(shown.weight, new.weight)
    mixed = make_layer(_weighted(new.colour, shown.colour, share), coverage, weight, _mixed_bands(shown, new, share))
    assert mixed is not None, "two pictures that cover something cannot cover nothing together"
    return mixed


def _mixed_bands(shown: Layer, new: Layer, share: Image) -> Bands | None:
    """The bands of both in the shares that their colours have; None if nobody wants them."""
    if shown.bands is None or new.bands is None:
        return None
    of_new = share[..., None].astype(np.uint32)
    return np.asarray((new.bands * of_new + shown.bands * (255 - of_new) + 127) // 255).astype(new.bands.dtype)


def _weighted(a: Image, b: Image, share_a: Image) -> Image:
    """(a * share + b * (255 - share)) / 255, rounded exactly, in integers: half the time of cv2.blendLinear."""
    share = np.asarray(cv2.merge([share_a] * 3), dtype=np.uint8)
    total = np.multiply(a, share, dtype=np.uint16)
    total += np.multiply(b, ~share, dtype=np.uint16)
    total += 128
    total += total >> 8
    total >>= 8
    return total.astype(np.uint8)
