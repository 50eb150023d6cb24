"""Wedges of one colour around a picture that was rotated, rectified, undistorted or stabilised before it came.

Ground can be black or white, too: at night, deep water, a burnt sky or roof. So a region counts as empty only if it is all black,
or all white, to the last pixel, as no sensor leaves what it looks at; if it takes a good part of the frame's border; if the step
to the picture is sharp; and if the outline is that of a warped frame: edges in more than one direction, each straight or smoothly
bent over a long way. What fails one of these stays ground, as it always was.
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from gcs_mosaic.stitch.arrays import AnyArray, Bands, Mask
from gcs_mosaic.stitch.camera.picture_area import PictureArea

LONGEST = 1024  # px of the picture that is looked at, which has every n-th pixel of the frame
RING = 256  # px along each side that are looked at first
LEAST_RING = 0.2  # share of the frame's border: of a frame rotated about its middle half, however little it is rotated
CLOSE = 2  # grey levels that a pixel of an empty region may be off, by compression
LEAST_REGION = 1e-3  # share of the frame of one region, be it told or found
LEAST_EMPTY, LEAST_PICTURE = 5e-3, 0.1  # shares of all empty regions, and of what is left
LEAST_TOLD = 0.02  # share that is left of a picture as its file tells it: some write an alpha that means nothing
BENT = 1.0  # px that an outline may leave its edges
LEAST_EDGE = 24.0  # px of the mean edge: an outline of ground has one every few pixels
LEAST_TURN = 30.0  # degrees between two of them: a quay, a shore or a horizon is one edge
# Beside the edge, px, the picture differs from the empty regions by so many grey levels, and by such a share of what it does
# deeper inside: light that falls off to black, or fades into a glare, does not.
RIM, DEEPER, STEP, SHARP = (1.5, 4.0), (10.0, 20.0), 24.0, 0.8
# In JPEGs: how far an edge disturbs the black beside it, px of the frame (across a block of 16 x 16 px), and by how many
# grey levels.
RINGING, RINGING_LEVELS = 23.0, 32


def area_of(image: Bands, told: Mask | None = None) -> PictureArea | None:
    """Where a frame (h, w, bands), reduced or not, holds a picture; None if everywhere. `told`: the pixels that do as its file
    says, which is believed; without, it is judged by the pixels."""
    holds = _picture_in(image) if told is None else _without_specks(told)
    return None if holds is None else PictureArea.of(holds)


def _without_specks(told: Mask) -> Mask | None:
    """Small regions may be dead pixels, or anything."""
    empty = _large(~told, touching=False)
    return ~empty if empty.any() and 1 - empty.mean() >= LEAST_TOLD else None


def _picture_in(image: Bands) -> Mask | None:
    """Every n-th pixel (h, w) that belongs to the picture; None if all do."""
    for value in (0, 255) if image.dtype == np.uint8 else (0,):
        if _share_of_ring(image, value) >= LEAST_RING and (found := _within_one_colour(image, value)) is not None:
            return found
    return None


def _share_of_ring(image: Bands, value: int) -> float:
    down, across = (max(1, size // RING) for size in image.shape[:2])
    sides = image[0, ::across], image[-1, ::across], image[::down, 0], image[::down, -1]
    return float(_are(np.concatenate(sides), value).mean())


def _are(pixels: AnyArray, value: int, within: int = CLOSE) -> Mask:
    """Which pixels (..., bands) have one value in all bands; 16 bits exactly."""
    if pixels.dtype != np.uint8:
        return np.asarray(~pixels.any(axis=-1))
    low, high = max(0, value - within), min(255, value + within)
    return np.asarray(((pixels >= low) & (pixels <= high)).all(axis=-1))


def _within_one_colour(image: Bands, value: int) -> Mask | None:
    step = math.ceil(max(image.shape[:2]) / LONGEST)
    some = image[::step, ::step]
    empty = _large(_are(some, value), touching=True)
    if not LEAST_EMPTY <= empty.mean() <= 1 - LEAST_PICTURE:
        return None
    exact = _largest(~empty)
    picture: Mask | None = exact
    near = cv2.dilate(exact.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0  # where resampling leaves single pixels
    if (~empty & ~near).any() or not _is_warped_frame(exact):
        picture = _convex(some, empty, value, RINGING / step) if image.dtype == np.uint8 else None
    return picture if picture is not None and _is_step(some, picture, value) else None


def _large(pixels: Mask, *, touching: bool) -> Mask:
    """Connected pixels (h, w) of a share worth it; `touching`: that reach the border."""
    _, labels, boxes, _ = cv2.connectedComponentsWithStats(pixels.astype(np.uint8), connectivity=4)
    large = boxes[:, cv2.CC_STAT_AREA] >= LEAST_REGION * pixels.size
    large[0] = False
    if touching:
        at_border = np.unique(np.concatenate([labels[0], labels[-1], labels[:, 0], labels[:, -1]]))
        large &= np.isin(np.arange(len(large)), at_border)
    return np.asarray(large[labels])


def _largest(pixels: Mask) -> Mask:
    _, labels, boxes, _ = cv2.connectedComponentsWithStats(pixels.astype(np.uint8), connectivity=8)
    return np.asarray(labels == 1 + boxes[1:, cv2.CC_STAT_AREA].argmax()) & pixels


def _is_warped_frame(picture: Mask) -> bool:
    """Whether the outline of a picture (h, w) has a few long edges besides the frame's border."""
    outlines, _ = cv2.findContours(picture.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    corners = cv2.approxPolyDP(max(outlines, key=len), BENT, True)[:, 0].astype(np.float64)
    edges = _edges_within(corners, picture.shape)
    lengths = np.linalg.norm(edges, axis=1)
    if not len(edges) or lengths.mean() < LEAST_EDGE:
        return False
    directions = (edges / lengths[:, None])[lengths >= LEAST_EDGE]
    return bool(np.abs(directions @ directions.T).min() <= np.cos(np.radians(LEAST_TURN)))


def _edges_within(corners: AnyArray, shape: tuple[int, ...]) -> AnyArray:
    """Edges (n, 2) of a polygon that are not along the border of a picture of this shape."""
    following = np.roll(corners, -1, axis=0)
    most = np.array(shape[::-1]) - 1
    low, high = (np.abs(np.stack([corners, following]) - side).max(axis=0) <= BENT for side in (0, most))
    return np.asarray((following - corners)[~(low | high).any(axis=1)])


def _is_step(some: Bands, picture: Mask, value: int) -> bool:
    """Whether the picture (h, w) begins at once: light that falls off to black, or a glare that fades, does not."""
    if some.dtype != np.uint8:
        return True
    inside = cv2.distanceTransform(picture.astype(np.uint8), cv2.DIST_L2, 5)
    at_rim, deeper = (_median_off(some[(inside > least) & (inside <= most)], value) for least, most in (RIM, DEEPER))
    return at_rim >= max(STEP, SHARP * deeper)


def _median_off(pixels: AnyArray, value: int) -> float:
    """Of pixels (n, bands): how far they are from one value, in the band that is farthest."""
    return float(np.median(np.abs(pixels.astype(np.int16) - value).max(axis=1))) if len(pixels) else 0.0


def _convex(some: Bands, empty: Mask, value: int, reach: float) -> Mask | None:
    """Of a JPEG, whose edges disturb the black beside them: the convex hull of all that is clearly not of the one colour, if the
    rest is, to within `reach` px of the hull."""
    clearly = ~_are(some, value, RINGING_LEVELS)
    if clearly.mean() < LEAST_PICTURE:
        return None
    y, x = np.nonzero(_largest(clearly))
    hull = cv2.convexHull(np.column_stack([x, y]).astype(np.int32))
    within = np.zeros(empty.shape, np.uint8)
    cv2.fillConvexPoly(within, hull, 1)
    inside, outside = (cv2.distanceTransform(one, cv2.DIST_L2, 5) for one in (within, 1 - within))
    is_rest_empty = not (~empty & (outside > reach)).any()
    is_hull_full = not (empty & (inside > reach)).any()
    return inside > 1.0 if is_rest_empty and is_hull_full and _is_warped_frame(within > 0) else None
