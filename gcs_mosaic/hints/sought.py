"""A colour that somebody has picked, sought in pictures."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.hints.anomalies import Appearance, Blob, blobs
from gcs_mosaic.stitch.arrays import FloatImage

LIGHTNESS = 0.4  # weight of a difference in lightness
LIGHTS = (
    (1.0, 0.0),
    (0.6, 4.0),
    (1.3, 4.0),
)  # the same jacket in the shade, and in the sun; and what that adds to the distance


@dataclass(frozen=True, slots=True, kw_only=True)
class SoughtColour:
    """`bgr`: 8 bits each; `tolerance`: distance in CIE L*a*b* (8 bits) up to which a colour is taken for it."""

    number: int
    bgr: tuple[int, int, int]
    tolerance: float

    def lab(self, light: float) -> NDArray[np.float32]:
        """(3,) of 8 bits, in another light: 1 is that in which it was picked."""
        lit = np.clip(np.array(self.bgr) * light, 0, 255).astype(np.uint8)
        return np.asarray(cv2.cvtColor(lit[None, None], cv2.COLOR_BGR2Lab)[0, 0], np.float32)


def likeness(seen: Appearance, colour: SoughtColour) -> FloatImage:
    """Of each pixel (h, w): 1 where it has that colour, 0 at the tolerance, less beyond."""
    values = seen.lab.astype(np.float32)
    nearest = np.full(values.shape[:2], np.inf, np.float32)
    for light, dearer in LIGHTS:
        apart = values - colour.lab(light)
        apart[..., 0] *= LIGHTNESS
        nearest = np.minimum(nearest, np.sqrt(np.einsum("hwc,hwc->hw", apart, apart)) + dearer)
    return np.asarray(1 - nearest / colour.tolerance, np.float32)


def of_colour(seen: Appearance, colour: SoughtColour, most: int) -> list[tuple[Blob, float]]:
    """The small things of a colour, the most alike first, with their likeness (0 to 1)."""
    alike = likeness(seen, colour)
    return [(blob, float(alike[blob.y, blob.x])) for blob in blobs(alike, 0.0, most)]
