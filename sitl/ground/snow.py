"""Open snow: almost white, with faint sastrugi, a few tracks, stones and bushes.

Sastrugi are ridges that the wind carves, decimetres to metres wide, several times as long, along the wind.
"""

from __future__ import annotations

import cv2
import numpy as np

from .noise import fractal
from .parcels import wander
from .raster import SHIFT, Field, Image, fixed, fixed_length, strips

WHITE = np.array([238, 234, 230], np.float32)  # BGR in the sun
SHADOW = np.array([205, 190, 180], np.float32)  # BGR in a track
LONG = 4  # times as long as wide
CONTRAST = 0.011  # relative brightness per standard deviation of the sastrugi
DRIFTS = 0.012  # ... of drifts of ten metres and more
TRACKS, TRACK = 3, 0.25  # number across the world, and metres of width
BARE_EVERY = 220.0  # square metres of snow per stone or bush
STONE, BUSH = (108, 112, 116), (58, 76, 84)  # BGR


def paint_snow(seed: int, size: int, gsd: float) -> Image:
    """-> (size, size, 3) BGR."""
    rng = np.random.default_rng([seed, 23])
    ridges, coarse = sastrugi(rng, size), fractal(rng, size // 4, coarsest=128, finest=16)
    drifts = cv2.resize(coarse, (size, size), interpolation=cv2.INTER_LINEAR)
    picture = np.empty((size, size, 3), np.uint8)
    for rows in strips(size):
        light = 1 + CONTRAST * ridges[rows] + DRIFTS * drifts[rows]
        picture[rows] = np.clip(WHITE * light[..., None] + 0.5, 0, 255)
    for _ in range(TRACKS):
        line = [fixed(wander(rng, size * gsd), gsd)]
        cv2.polylines(picture, line, False, SHADOW.tolist(), max(1, round(TRACK / gsd)), cv2.LINE_AA, SHIFT)
    strew_bare(rng, picture, gsd)
    return picture


def sastrugi(rng: np.random.Generator, size: int) -> Field:
    """(size, size) noise of mean 0 and deviation 1, drawn out along the wind."""
    noise, course = fractal(rng, size, coarsest=32), rng.uniform(0, np.pi)
    cos, sin = np.cos(course), np.sin(course)
    turn = np.array([[cos, sin], [-sin, cos]])
    linear = np.diag([1 / LONG, 1.0]) @ turn
    middle = np.full(2, size / 2)
    drawn = cv2.warpAffine(
        noise,
        np.c_[linear, middle - linear @ middle],
        (size, size),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_REFLECT,
    )
    return np.asarray((drawn - drawn.mean()) / drawn.std(), np.float32)


def strew_bare(rng: np.random.Generator, picture: Image, gsd: float) -> None:
    """Draw stones and bushes of some decimetres, in place."""
    side = len(picture) * gsd
    for place in rng.random((int(side**2 / BARE_EVERY), 2)) * side:
        colour, radius = (STONE, rng.gamma(3, 0.06)) if rng.random() < 0.5 else (BUSH, rng.gamma(4, 0.07))
        for away in rng.normal(0, 0.6 * radius, (3, 2)):
            x, y = fixed(place + away, gsd).tolist()
            cv2.circle(picture, (x, y), fixed_length(radius, gsd), colour, -1, cv2.LINE_AA, SHIFT)
