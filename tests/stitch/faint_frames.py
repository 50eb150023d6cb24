"""Frames of a thermal camera over cold fields: little contrast, much noise, and a pattern that stands still."""

import cv2
import numpy as np
from numpy.typing import NDArray
from stitch_ground import Image

from gcs_mosaic.stitch.arrays import Array
from gcs_mosaic.stitch.features.extraction import Features
from gcs_mosaic.stitch.registration.outcome import Registration
from gcs_mosaic.stitch.registration.registration import register
from gcs_mosaic.stitch.registration.settings import RegistrationSettings

WIDTH, HEIGHT = 400, 300

Levels = NDArray[np.float32]


def scene(seed: int = 0) -> Levels:
    """Ground (1200, 1200) whose structure is some ten pixels wide, deviation 1."""
    noise = np.random.default_rng(seed).normal(size=(1200, 1200)).astype(np.float32)
    wide = cv2.GaussianBlur(noise, (0, 0), 6)
    return np.asarray(wide / wide.std(), np.float32)


def fixed_pattern(contrast: float, seed: int = 7) -> Levels:
    """What stands still in every frame (HEIGHT, WIDTH): a grid, dirt, a vignette, writing; deviation of the first `contrast`."""
    rng = np.random.default_rng(seed)
    grid = rng.normal(size=(HEIGHT, WIDTH)).astype(np.float32)
    dirt = cv2.GaussianBlur(rng.normal(size=(HEIGHT, WIDTH)).astype(np.float32), (0, 0), 5)
    pattern = contrast * (grid + dirt / dirt.std())
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    pattern -= 40 * (((x - WIDTH / 2) / WIDTH) ** 2 + ((y - HEIGHT / 2) / HEIGHT) ** 2)
    writing = np.zeros((HEIGHT, WIDTH), np.uint8)
    cv2.putText(writing, "27.4 C", (20, 40), cv2.FONT_HERSHEY_SIMPLEX, 0.8, 60, 2)
    return np.asarray(pattern + writing, np.float32)


def frame(
    ground: Levels, x: int, y: int, seed: int, contrast: float = 2.0, noise: float = 3.0, pattern: Levels | float = 0.0
) -> Image:
    """What a camera of 8 bits sees at (x, y) of the ground: levels of deviation `contrast` under noise."""
    seen = contrast * ground[y : y + HEIGHT, x : x + WIDTH]
    noisy = 128 + seen + pattern + np.random.default_rng(seed).normal(0, noise, seen.shape)
    return np.asarray(np.clip(np.rint(noisy), 0, 255), np.uint8)


def motion(a: Features, b: Features) -> Array | None:
    """How far the middle of one frame lies from itself in another; None if they do not match."""
    found = register(a, b, RegistrationSettings())
    return (found.pixels_b - found.pixels_a).mean(axis=0) if isinstance(found, Registration) else None
