"""A look at places: how a person there would stand out of one measured picture."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from gcs_mosaic.detection.clutter import AROUND, GroundStatistics
from gcs_mosaic.detection.persons import COLOURS, Person
from gcs_mosaic.stitch.arrays import Array, PointsNx2

LEAST_LIGHT = 0.25  # of a picture's values in the sun, in the shade


@dataclass(frozen=True, slots=True)
class PlaceLook:
    """Of places (n,): the person's contrast beside what else stands out, in the sun and if what is dark is shade; deviation of
    L* on the ground, and how much two looks differ."""

    in_sun: Array
    in_shade: Array
    texture: Array
    disagreement: Array


def look_at(ground: GroundStatistics, differs: Array | None, pixels: PointsNx2, person: Person) -> PlaceLook:
    """At pixels (n, 2) of the original. `differs`: of `clutter.disagreement`; None if no other look is known."""
    row, column = ground.at(pixels)
    colours, covariances = ground.colours[row, column], ground.covariances[row, column]
    # L* goes with the cube root of light, a picture's values with its power of 1 / 2.2.
    light = np.clip(((colours[:, 0] + 16) / (ground.sunlit + 16)) ** (3 / 2.2), LEAST_LIGHT, 1.0)
    inverse = np.linalg.inv(covariances)

    def contrast(level: Array) -> Array:
        apart = lab_of(person, level) - colours
        alone = np.einsum("ni,nij,nj->n", apart, inverse, apart) * person.fill**2
        # Who lies there is taken for ground, too (Sherman and Morrison): on plain ground, where that is most of what differs,
        # nobody stands out by more than a share of the window tells.
        return np.asarray(np.sqrt(alone / (1 + alone * person.spread / AROUND**2)) / max(ground.tail, 1e-3))

    return PlaceLook(
        in_sun=contrast(np.ones(len(pixels))),
        in_shade=contrast(light),
        texture=np.sqrt(covariances[:, 0, 0]),
        disagreement=np.full(len(pixels), np.nan) if differs is None else differs[row, column],
    )


def lab_of(person: Person, light: Array) -> Array:
    """The clothes' CIE L*a*b* (..., 3) in so much light (...), 1 in the sun."""
    bgr = np.clip(np.multiply.outer(light, np.array(COLOURS[person.clothes], np.float64)) / 255, 0, 1)
    flat = np.asarray(bgr.reshape(-1, 1, 3), np.float32)
    return np.asarray(cv2.cvtColor(flat, cv2.COLOR_BGR2Lab).reshape(bgr.shape), np.float64)
