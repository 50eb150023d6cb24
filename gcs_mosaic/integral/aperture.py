"""How wide the synthetic aperture is, at one place."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gcs_mosaic.integral.focal_plane import camera_height, direction_to, pixels_at
from gcs_mosaic.integral.stack import GroundLook
from gcs_mosaic.stitch.arrays import Vector2


@dataclass(frozen=True, slots=True, kw_only=True)
class SyntheticAperture:
    """The looks that see a place. `spread_deg`: the largest angle between two of them, as seen from there; `width`: between the
    two cameras farthest apart over the ground, and `height` of the middle one, canvas units."""

    looks: int
    spread_deg: float
    width: float
    height: float

    @property
    def depth(self) -> float:
        """Share of the flying height by which the focus must be wrong to blur a point over a hundredth of that height."""
        return math.inf if self.width == 0 else 0.01 * self.height / self.width


def seeing(looks: Sequence[GroundLook], place: Vector2, height: float) -> list[GroundLook]:
    """The looks whose frames show a canvas place (2,) at a height."""
    found = []
    for look in looks:
        x, y = pixels_at(look.pose, look.camera, look.relief, place[None], height)[0].tolist()
        (left, top), (right, bottom) = look.dead.limits(look.camera.width, look.camera.height)
        if left < x < right and top < y < bottom:  # NaN is outside too
            found.append(look)
    return found


def aperture_of(looks: Sequence[GroundLook], place: Vector2, height: float) -> SyntheticAperture:
    """Of the looks that see a canvas place (2,) at a height in canvas units."""
    seen = seeing(looks, place, height)
    if not seen:
        return SyntheticAperture(looks=0, spread_deg=0.0, width=0.0, height=math.nan)
    directions = np.array([direction_to(one.pose, one.camera, place, height) for one in seen])
    nadirs = np.array([[one.pose.x, one.pose.y] for one in seen])
    widest = float(np.clip(directions @ directions.T, -1, 1).min())
    apart = float(np.linalg.norm(nadirs[:, None] - nadirs[None], axis=2).max())
    heights = float(np.median([camera_height(one.pose, one.camera) for one in seen]))
    return SyntheticAperture(looks=len(seen), spread_deg=math.degrees(math.acos(widest)), width=apart, height=heights)
