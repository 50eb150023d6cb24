"""Fractal noise, as on natural ground."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray


def fractal(rng: np.random.Generator, size: int, coarsest: int, finest: int = 1) -> NDArray[np.float32]:
    """A (size, size) field of mean 0 and standard deviation 1 with equal power in every octave.

    coarsest, finest: sizes of the largest and smallest features in pixels, powers of two. Equal power per octave is the
    1/f amplitude spectrum of natural images. Built coarse to fine by doubling, so it costs little more than the last step.
    """
    octaves = int(np.log2(coarsest // finest))
    field = np.zeros((1, 1), np.float32)
    for octave in range(octaves, -1, -1):
        side = -(-size // (finest << octave))
        field = cv2.resize(field, (side, side), interpolation=cv2.INTER_CUBIC).astype(np.float32, copy=False)
        field += rng.standard_normal((side, side), np.float32)
    field = cv2.resize(field, (size, size), interpolation=cv2.INTER_LINEAR).astype(np.float32, copy=False)
    field -= field.mean()
    field /= field.std()
    return field
