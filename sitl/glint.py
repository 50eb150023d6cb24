"""Waves and sun glint on water, different in every frame.

Glint concentrates around the specular reflection of the sun: fixed in the picture while the ground moves through it.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from .geometry import Array, CameraState, sinking_views
from .ground.noise import fractal
from .ground.objects import SUN
from .ground.raster import Field

ROUGH = 0.16  # radians: standard deviation of the wave slopes
CROWDED = 0.03  # share of glinting pixels at the specular point
SWELL = 0.07  # relative brightness change per standard deviation of the waves
PER_SECOND = 1000  # time resolution: frames 1 ms apart show different waves


def shimmer(colours: Field, water: Array, state: CameraState, rays: Array) -> None:
    """Add waves and glint to a picture (h, w, 3) where it shows water (h, w; 0 to 1), in place."""
    height, width = colours.shape[:2]
    rng = np.random.default_rng([16, round(state.time * PER_SECOND), round(state.x * PER_SECOND) % 2**32])
    waves = fractal(rng, max(height, width), coarsest=32)[:height, :width]
    sparks = (rng.random((height, width), np.float32) < CROWDED * towards_sun(state, rays)).astype(np.float32)
    sparks = np.asarray(cv2.GaussianBlur(sparks, (3, 3), 0.7), np.float32)
    shining = colours * (1 + SWELL * waves[..., None]) + 420 * sparks[..., None]
    share = np.asarray(water, np.float32)[..., None]
    colours += share * (np.minimum(shining, 255) - colours)


def towards_sun(state: CameraState, rays: Array) -> NDArray[np.float32]:
    """Strength of the sun's reflection along rays (h, w, 2): 1 at the specular point of level water."""
    east, south, down = sinking_views(state, rays)
    view = np.stack([east, south, down], axis=-1)
    view /= np.linalg.norm(view, axis=-1, keepdims=True)
    sun = np.array([-SUN[0], -SUN[1], 1.0])
    # A mirror inverts the vertical component only, so the angle to the sun equals that between the view and the mirrored sun.
    off = np.arccos(np.clip(view @ (sun / np.linalg.norm(sun)), -1, 1))
    return np.asarray(np.exp(-0.5 * (off / (2 * ROUGH)) ** 2), np.float32)
