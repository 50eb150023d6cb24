"""The paper's blend: alpha blending by distance to each frame's border, and steeper where edges are dense.

Dense edges (Canny, then a morphological closing) raise the new frame's weight. Portakal, Kındıroğlu, Uluyağmur Öztürk, "Real
Time Incremental Image Mosaicking Without Use of Any Camera Parameter", section III.D. Added here: where edges are dense, the
transition is also steep, so that such a place comes from one frame only.
"""

from __future__ import annotations

import cv2
import numpy as np

from gcs_mosaic.render.blend_maps import BlendMaps, Of
from gcs_mosaic.render.blending import LEAST_WEIGHT
from gcs_mosaic.render.cells import NOBODY, WHOLLY, Cells, Owned, Seen, Window
from gcs_mosaic.render.frame_warp import FrameWarp
from gcs_mosaic.render.sampling import at_cells, hindrance, inside, lattice_part, places_in, sampled
from gcs_mosaic.render.warp import shrunk
from gcs_mosaic.stitch.arrays import FloatImage, ImageBGR, ImageGrey, Lattice

EDGE_PIXELS = 750_000  # image size for edge detection; finer edges are noise and grass
STRONGEST = 0.1  # share of a frame's pixels that may start an edge: lighting varies too much for fixed thresholds
LEAST_GRADIENT = 24  # of the Sobel operator, grey levels; below is the noise of uniform ground
CLOSING = 5  # px at that size
NEIGHBOURHOOD = 31  # px at that size over which edge density is averaged; about a tree
DENSE = 0.4  # share of pixels on closed edges that counts as fully dense
BOOST = 1.3  # factor on the new frame's weight where edges are dense
SOFT, STEEP = 4.0, 32.0  # exponents of the weight ratio on smooth ground and where edges are dense


def edge_density(look: ImageBGR) -> FloatImage:
    """Edge density around each place of a frame, 0 to 1, (h, w, 1), at a quarter of the width of the ~0.75 MP image it is
    computed from."""
    small = shrunk(look, EDGE_PIXELS)
    size = small.shape[1], small.shape[0]
    grey = cv2.cvtColor(small, cv2.COLOR_BGR2GRAY)
    edges = _edges(np.asarray(grey, dtype=np.uint8))
    closed = cv2.morphologyEx(edges, cv2.MORPH_CLOSE, np.ones((CLOSING, CLOSING), np.uint8))
    quarter = max(1, size[0] // 4), max(1, size[1] // 4)
    share = cv2.resize(cv2.blur(closed, (NEIGHBOURHOOD, NEIGHBOURHOOD)), quarter, interpolation=cv2.INTER_AREA)
    return np.asarray(np.minimum(share / (255 * DENSE), 1), dtype=np.float32)[..., None]


def _edges(grey: ImageGrey) -> ImageGrey:
    dx, dy = cv2.Sobel(grey, cv2.CV_16S, 1, 0), cv2.Sobel(grey, cv2.CV_16S, 0, 1)
    some = np.abs(dx[::4, ::4]).astype(np.int32) + np.abs(dy[::4, ::4])
    high = max(float(np.quantile(some, 1 - STRONGEST)), LEAST_GRADIENT)
    return np.asarray(cv2.Canny(dx, dy, high / 2.5, high), dtype=np.uint8)


def look_for_edges(look: ImageBGR, of: Of) -> BlendMaps:
    """What is kept of a frame's image: its edge density."""
    density = edge_density(look)
    return BlendMaps(of, (np.asarray(np.rint(density * 255), np.uint8),))


def see(frame: FrameWarp, maps: BlendMaps | None, window: Window) -> Seen:
    """A frame's contribution to the cells of a window: log weight and edge density."""
    assert maps is not None, "edges need a look"
    where = lattice_part(frame.lattice, window)
    pixels, weight = at_cells(frame.lattice.pixels[where]), at_cells(frame.lattice.weight[where])
    density = sampled(maps.planes[0], places_in(pixels, frame.lattice, maps.planes[0].shape))
    covered = inside(frame.lattice, where)
    score = np.log(np.maximum(weight, LEAST_WEIGHT)) - hindrance(frame.lattice, where, covered)
    return Seen(covered, np.asarray(score, np.float32), density.reshape(1, *weight.shape))


def decide(cells: Cells, seen: Seen) -> Lattice:
    """Log ratio of weights, soft on smooth ground and steep where the new frame's edges are dense."""
    density = seen.planes[0] / np.float32(255)
    steepness = SOFT + (STEEP - SOFT) * density
    return np.asarray(steepness * (seen.score - cells.score + np.log(1 + (BOOST - 1) * density)), np.float32)


def mixed(cells: Cells) -> Owned:
    """The first with its share, where both cover the cell."""
    both = (cells.inside[0] == WHOLLY) & (cells.inside[1] == WHOLLY)
    share = np.where(both, np.rint(255 / (1 + np.exp(-np.minimum(cells.lead, 30)))), 255).astype(np.uint8)
    shown = (share < 255) | (cells.inside[0] != WHOLLY)
    return Owned(cells.first, np.where(shown, cells.second, np.int32(NOBODY)), share)
