"""What stands out in a frame: small things that differ from their surroundings far more than anything around them does.

A thing stands out by being brighter, redder or yellower than the mean of the square around it, or darker, greener or bluer:
six maps of contrast by opponent colours, centre against surround, as in L. Itti, C. Koch and E. Niebur, "A Model of
Saliency-Based Visual Attention for Rapid Scene Analysis", PAMI 20(11), 1998. Each counts against what is usual all around,
colours also against the light beside them: towards the corners of a frame lenses give bright edges coloured fringes.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.uint8]
Map = NDArray[np.float32]

# All lengths are pixels of the picture that a frame is looked at in (see `looks.LOOK_PIXELS`).
CENTRE = 3  # smaller is noise
SURROUND = 41  # some times a person
USUAL = 121  # square over which the usual contrast is told
DISTINCT = 5.0  # times the usual contrast at which a thing stands out; crowns in a wood and stones on a beach seldom do
# Steps of L, a and b (8 bit) below which nothing stands out; what is fainter no eye finds.
LEAST_CONTRAST = np.array([20, 10, 10] * 2, np.float32)
FRINGE = 0.5  # of the contrast in L beside it that one in a or b must have: less may be what a lens does to edges
REACH = 12  # around a thing, still as salient as itself: more than half a lattice step, so that all of it is meant
MISPLACED = 8  # what a low thing may be shifted by in another frame: hardly more than a person is wide
TALL = 60  # what a tall thing may be shifted by, seen from another side; somebody who walks may get as far, too
POOL = 4  # pixels a side that share a value
WAYS = len(LEAST_CONTRAST)  # in which a thing can stand out


def saliency(look: Image) -> tuple[Map, Map, Map]:
    """Of a picture (h, w, 3), a quarter as wide, each with `WAYS` channels: the contrast of the thing that stands out at or
    beside a place, 0 if there is none; and the greatest contrast, thing or not, anywhere around it, near and far.

    The first is nowhere above the second, and if frames show the same thing, not above the second of another frame either;
    nor above the third, if that thing is tall.
    """
    centre, surround = _centre_and_surround(look)
    contrast = _contrast(centre, surround)
    around = USUAL // POOL | 1
    usual = cv2.blur(_quarter(cv2.absdiff(centre, surround)), (around, around), borderType=cv2.BORDER_REFLECT)
    light = _greatest(np.maximum(contrast[..., 0], contrast[..., 3]), POOL)
    fringes = FRINGE * np.dstack([np.zeros_like(light), light, light] * 2)
    bound = np.maximum(np.maximum(DISTINCT * np.dstack([usual, usual]), LEAST_CONTRAST), fringes)
    things = np.where(contrast > bound, contrast, 0)
    return _greatest(things, REACH), _greatest(contrast, REACH + MISPLACED), _greatest(contrast, REACH + TALL)


def greatest_contrast(look: Image, reach: int) -> Map:
    """The greatest contrast, thing or not, anywhere within `reach` px of a picture (h, w, 3), a quarter as wide, in `WAYS`."""
    return _greatest(_contrast(*_centre_and_surround(look)), reach)


def _centre_and_surround(look: Image) -> tuple[Image, Image]:
    lab = cv2.cvtColor(look, cv2.COLOR_BGR2Lab)
    centre, surround = (np.asarray(cv2.blur(lab, (side, side)), np.uint8) for side in (CENTRE, SURROUND))
    return centre, surround


def _contrast(centre: Image, surround: Image) -> Image:
    ways = *cv2.split(cv2.subtract(centre, surround)), *cv2.split(cv2.subtract(surround, centre))
    return np.dstack([_pooled(way) for way in ways])


def _pooled(values: cv2.typing.MatLike) -> NDArray[np.uint8]:
    """The greatest of all values around each fourth pixel."""
    size = max(1, values.shape[1] // POOL), max(1, values.shape[0] // POOL)
    widest = cv2.dilate(values, np.ones((POOL + 1, POOL + 1), np.uint8))
    return np.asarray(cv2.resize(widest, size, interpolation=cv2.INTER_NEAREST), dtype=np.uint8)


def _quarter(values: cv2.typing.MatLike) -> Map:
    size = max(1, values.shape[1] // POOL), max(1, values.shape[0] // POOL)
    return np.asarray(cv2.resize(values, size, interpolation=cv2.INTER_AREA), dtype=np.float32)


def _greatest(values: NDArray[np.uint8], reach: int) -> Map:
    side = 2 * (reach // POOL) + 1
    return np.asarray(cv2.dilate(values, np.ones((side, side), np.uint8)), dtype=np.float32)
