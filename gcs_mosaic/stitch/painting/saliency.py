"""What stands out in a frame: small things that differ from their surroundings far more than anything around them does.

The contrast of a place is how far it is from the mean of the square around it, in the channel where that is most (a
centre-surround difference, as in L. Itti, C. Koch and E. Niebur, "A Model of Saliency-Based Visual Attention for Rapid Scene
Analysis", PAMI 20(11), 1998), and it counts against the contrast that is usual all around.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.uint8]
Map = NDArray[np.float32]

# All lengths are pixels of the picture that a frame is looked at in (see `view.LOOK_PIXELS`).
CENTRE = 3  # smaller is noise
SURROUND = 41  # some times a person
USUAL = 121  # square over which the usual contrast is told
# Times the usual contrast at which a thing stands out, and at which there may be one: crowns in a wood and stones on a beach
# do not stand out; and what does so in one frame may do it half as much in another.
STRONG, WEAK = 5.0, 2.0
# Grey levels below which nothing stands out, and nothing may: below is noise.
LEAST_STRONG, LEAST_WEAK = 20, 8
# Around a thing, still as salient as itself: what a lattice step may miss of it, and what relief and parallax may shift it by.
REACH = 16
MISPLACED = 12
FALL = 8  # over which salience falls to nothing


def saliency(look: Image) -> tuple[Map, Map]:
    """Where things stand out in a picture (h, w, 3), and where things may: two maps a quarter as wide, 0 to 1.

    Whatever is salient in the first is so in the second, and more widely.
    """
    differences = cv2.absdiff(cv2.blur(look, (CENTRE, CENTRE)), cv2.blur(look, (SURROUND, SURROUND)))
    contrast = np.asarray(np.max(cv2.split(differences), axis=0), dtype=np.uint8)
    usual = np.asarray(cv2.blur(contrast, (USUAL, USUAL), borderType=cv2.BORDER_REFLECT), dtype=np.uint8)
    strong = cv2.compare(contrast, _bound(usual, STRONG, LEAST_STRONG), cv2.CMP_GT)
    weak = cv2.compare(contrast, _bound(usual, WEAK, LEAST_WEAK), cv2.CMP_GT)
    return _grown(strong, REACH), _grown(weak, REACH + FALL + MISPLACED)


def _bound(usual: Image, ratio: float, least: int) -> Image:
    return np.asarray(np.maximum(cv2.convertScaleAbs(usual, alpha=ratio), least), dtype=np.uint8)


def _grown(things: cv2.typing.MatLike, reach: int) -> Map:
    """Things (0 or 255) with what is around them, a quarter as wide."""
    quarter = max(1, things.shape[1] // 4), max(1, things.shape[0] // 4)
    # The greatest of 4 x 4 pixels, because a thing may be no larger than one.
    pooled = cv2.resize(cv2.dilate(things, np.ones((5, 5), np.uint8)), quarter, interpolation=cv2.INTER_NEAREST)
    wide = 2 * ((reach + FALL // 2) // 4) + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (wide, wide))
    soft = 2 * (FALL // 8) + 1
    return np.asarray(cv2.blur(cv2.dilate(pooled, disc), (soft, soft)) / np.float32(255), dtype=np.float32)
