"""Small things in one picture that differ from their surroundings as little else in it does, in whatever direction of colour.

The detector of I. S. Reed and X. Yu, "Adaptive Multiple-Band CFAR Detection of an Optical Pattern with Unknown Spectral
Distribution", IEEE Trans. ASSP 38(10), 1990 (RX): the Mahalanobis distance of a pixel to the mean of the square around it, by the
covariance of the whole picture. Here it is taken of lightness and colour (CIE L*a*b*), and relative to what is usual around.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.stitch.arrays import FloatImage, ImageBGR

# All lengths are pixels of the analysed picture.
CENTRE = 3  # smaller is noise
SURROUND = 41  # a few times a person
USUAL = 161  # square over which the usual contrast is averaged
LARGEST = 48  # side of what is still small: a tent, hardly a car
LEAST_AREA = 3
QUIET = 0.3  # of the picture's mean squared contrast: where it is quieter, noise is no thing
EACH = 4  # of so many rows and columns the covariance is taken


@dataclass(frozen=True, slots=True)
class Appearance:
    """A picture as it is analysed, maps of the same size (h, w)."""

    lab: ImageBGR  # CIE L*a*b* of 8 bits (h, w, 3), blurred a little
    contrast: FloatImage  # Mahalanobis distance to the surroundings, relative to what is usual around


@dataclass(frozen=True, slots=True, kw_only=True)
class Blob:
    """A small thing: its box, and its pixel that differs most; pixels of the analysed picture."""

    left: int
    top: int
    width: int
    height: int
    x: int
    y: int


def appearance(picture: ImageBGR) -> Appearance:
    """Of a picture (h, w, 3)."""
    lab = np.asarray(cv2.blur(cv2.cvtColor(picture, cv2.COLOR_BGR2Lab), (CENTRE, CENTRE)), np.uint8)
    values = lab.astype(np.float32)
    local = values - cv2.blur(values, (SURROUND, SURROUND), borderType=cv2.BORDER_REFLECT)
    some = local[::EACH, ::EACH].reshape(-1, 3)
    covariance = some.T @ some / len(some) + np.eye(3, dtype=np.float32)  # a step of 8 bits is noise in any case
    whitened = cv2.transform(local, np.linalg.inv(np.linalg.cholesky(covariance)).astype(np.float32))
    squared = np.einsum("hwc,hwc->hw", whitened, whitened)
    usual = cv2.blur(squared, (USUAL, USUAL), borderType=cv2.BORDER_REFLECT)
    floor = QUIET * float(squared[::EACH, ::EACH].mean())
    return Appearance(lab, np.asarray(np.sqrt(squared / np.maximum(usual, floor + 1e-6)), np.float32))


def blobs(oddity: FloatImage, least: float, most: int) -> list[Blob]:
    """The small connected things of at least so much oddity in a map (h, w), the oddest first, `most` of them."""
    mask = cv2.morphologyEx((oddity >= least).astype(np.uint8), cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    _, labels, boxes, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    small = (boxes[:, 2] <= LARGEST) & (boxes[:, 3] <= LARGEST) & (boxes[:, 4] >= LEAST_AREA)
    small[0] = False  # the ground
    rows, columns = np.nonzero(small[labels])
    things, oddities = labels[rows, columns], oddity[rows, columns]
    order = np.lexsort((-oddities, things))
    peaks = order[np.unique(things[order], return_index=True)[1]]  # the oddest pixel of each
    best = peaks[np.argsort(-oddities[peaks], kind="stable")[:most]]
    return [_blob(boxes[things[one]], int(columns[one]), int(rows[one])) for one in best]


def _blob(box: NDArray[np.int32], x: int, y: int) -> Blob:
    left, top, width, height = (int(side) for side in box[:4])
    return Blob(left=left, top=top, width=width, height=height, x=x, y=y)
