"""Saliency: small things that differ from their surroundings far more than anything else around.

A thing is salient by being brighter, redder or yellower than the mean of the square around it, or darker, greener or bluer: six
centre-surround contrast maps by opponent colours, as in L. Itti, C. Koch and E. Niebur, "A Model of Saliency-Based Visual
Attention for Rapid Scene Analysis", PAMI 20(11), 1998. Each is relative to the usual local contrast, and colour also to the
adjacent lightness contrast: lenses give bright edges coloured fringes towards the corners.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from gcs_mosaic.stitch.arrays import FloatImage, ImageBGR, ImageGrey, Planes, PlaneStack

# All lengths are pixels of the analysed image (see `looks.LOOK_PIXELS`).
CENTRE = 3  # smaller is noise
SURROUND = 41  # a few times a person
USUAL = 121  # square over which the usual contrast is averaged
DISTINCT = 5.0  # ratio to the usual contrast of a salient thing; tree crowns and stones on a beach seldom reach it
# Minimum contrast in steps of L, a and b (8 bit); anything fainter is invisible.
LEAST_CONTRAST = np.array([20, 10, 10] * 2, np.float32)
FRINGE = 0.5  # minimum contrast in a or b relative to that in L beside it: less may be a lens' colour fringe
REACH = 12  # margin around a thing with its full salience: more than half a lattice step, to include all of it
MISPLACED = 8  # displacement of a low thing in another frame: hardly more than a person is wide
TALL = 60  # displacement of a tall thing seen from another side; a walking person may move as far
POOL = 4  # pixels a side that share a value
WAYS = len(LEAST_CONTRAST)  # kinds of contrast


def saliency(look: ImageBGR) -> tuple[Planes, Planes, Planes]:
    """Of an image (h, w, 3), at a quarter of the width, `WAYS` planes each: contrast of the salient thing at or beside a place,
    else 0; and the greatest contrast, of a thing or not, anywhere near and far around it.

    The first never exceeds the second nor, if frames show the same thing, the second of another frame; nor the third, if that
    thing is tall.
    """
    centre, surround = _centre_and_surround(look)
    contrast = _contrast(centre, surround)
    around = USUAL // POOL | 1
    usual = cv2.blur(_quarter(cv2.absdiff(centre, surround)), (around, around), borderType=cv2.BORDER_REFLECT)
    fringes = np.float32(FRINGE) * _greatest([np.maximum(contrast[0], contrast[3])], POOL)[0]
    things: list[ImageGrey] = []
    for found, of_usual, least in zip(contrast, [*cv2.split(usual)] * 2, LEAST_CONTRAST, strict=True):
        bound = np.maximum(np.float32(DISTINCT) * of_usual, least)
        if len(things) % 3:  # of colour
            bound = np.maximum(bound, fringes)
        things.append(np.where(found > bound, found, np.uint8(0)))
    return _greatest(things, REACH), _greatest(contrast, REACH + MISPLACED), _greatest(contrast, REACH + TALL)


def greatest_contrast(look: ImageBGR, reach: int) -> Planes:
    """Greatest contrast, of a thing or not, within `reach` px in an image (h, w, 3), at a quarter of the width, `WAYS` planes."""
    return _greatest(_contrast(*_centre_and_surround(look)), reach)


def _centre_and_surround(look: ImageBGR) -> tuple[PlaneStack, PlaneStack]:
    lab = cv2.cvtColor(look, cv2.COLOR_BGR2Lab)
    centre, surround = (np.asarray(cv2.blur(lab, (side, side)), np.uint8) for side in (CENTRE, SURROUND))
    return centre, surround


def _contrast(centre: PlaneStack, surround: PlaneStack) -> list[ImageGrey]:
    signed = cv2.subtract(centre, surround), cv2.subtract(surround, centre)
    return [np.asarray(way, np.uint8) for both in signed for way in cv2.split(_pooled(both))]


def _pooled(values: cv2.typing.MatLike) -> cv2.typing.MatLike:
    """Maximum of all values around each fourth pixel, for each channel."""
    size = max(1, values.shape[1] // POOL), max(1, values.shape[0] // POOL)
    widest = cv2.dilate(values, np.ones((POOL + 1, POOL + 1), np.uint8))
    return cv2.resize(widest, size, interpolation=cv2.INTER_NEAREST)


def _quarter(values: cv2.typing.MatLike) -> FloatImage:
    size = max(1, values.shape[1] // POOL), max(1, values.shape[0] // POOL)
    return np.asarray(cv2.resize(values, size, interpolation=cv2.INTER_AREA), dtype=np.float32)


def _greatest(values: Sequence[ImageGrey], reach: int) -> Planes:
    side = 2 * (reach // POOL) + 1
    return np.stack([np.asarray(cv2.dilate(one, np.ones((side, side), np.uint8)), np.uint8) for one in values])
