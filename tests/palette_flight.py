"""Thermal flights in serpentines, as cameras show them: palettes or greys over each frame's own range, with a legend burnt in."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from tests.thermal import Counts

Colours = NDArray[np.uint8]

WIDTH, HEIGHT = 320, 240
AHEAD, ASIDE = 110, 130  # px between frames along a leg, and between legs
BAR = slice(40, 200), slice(298, 310)  # rows and columns of the legend's bar
NOISE = 4.0  # counts
# Of FLIR's "iron": blue, violet, orange, yellow, white.
_IRON = np.array(
    [(0, 0, 0), (140, 0, 32), (155, 0, 145), (70, 70, 230), (20, 160, 250), (90, 235, 255), (255, 255, 255)]
)
IRON = np.stack([np.interp(np.arange(256), np.linspace(0, 255, 7), _IRON[:, k]) for k in range(3)], -1).astype(np.uint8)
RAINBOW = np.asarray(cv2.applyColorMap(np.arange(256, dtype=np.uint8)[:, None], cv2.COLORMAP_JET), np.uint8)[:, 0]


@dataclass(frozen=True, slots=True)
class Survey:
    """Counts of ground (h, w), and the left upper corner (x, y) of each frame."""

    ground: Counts
    corners: tuple[tuple[int, int], ...]

    def frames(self, seed: int = 2) -> Iterator[Counts]:
        rng = np.random.default_rng(seed)
        for x, y in self.corners:
            yield self.ground[y : y + HEIGHT, x : x + WIDTH] + rng.normal(0, NOISE, (HEIGHT, WIDTH)).astype(np.float32)


def survey(
    legs: int, each: int, base: float = 27_800.0, contrast: float = 60.0, gradient: float = 0.0, seed: int = 7
) -> Survey:
    """Legs of so many frames over things of all sizes; `gradient`: counts from one corner to the other."""
    height, width = HEIGHT + ASIDE * (legs - 1), WIDTH + AHEAD * (each - 1)
    rng = np.random.default_rng(seed)
    total = np.zeros((height, width), np.float32)
    for sigma, strength in ((2, 0.5), (5, 0.8), (12, 1.0), (40, 1.5)):
        soft = cv2.GaussianBlur(rng.normal(size=(height, width)).astype(np.float32), (0, 0), sigma)
        total += strength * soft / soft.std()
    for _ in range(12 * legs * each):
        x, y = int(rng.integers(width)), int(rng.integers(height))
        size = rng.integers(6, 40, 2)
        cv2.rectangle(total, (x, y), (x + int(size[0]), y + int(size[1])), float(rng.normal(0, 3)), -1)
    slope = np.linspace(0, 1, width)[None] + np.linspace(0, 1, height)[:, None]
    ground = base + contrast * total / total.std() + gradient * (slope / 2 - 0.5)
    there = [(AHEAD * (k if leg % 2 == 0 else each - 1 - k), ASIDE * leg) for leg in range(legs) for k in range(each)]
    return Survey(np.asarray(ground, np.float32), tuple(there))


def levels(counts: Counts) -> Colours:
    """Grey levels over a frame's own range, but for a hundredth at either end."""
    low, high = np.quantile(counts, [0.01, 0.99])
    return np.asarray(np.clip((counts - low) / (high - low) * 255, 0, 255), np.uint8)


def coloured(palette: Colours, *, legend: bool = True) -> Callable[[Counts], Colours]:
    """A camera's rendering in a palette, with a bar, what its ends mean, a spot's temperature, a cross and a logo."""

    def rendering(counts: Counts) -> Colours:
        picture = palette[levels(counts)]
        return burnt(picture, counts, palette) if legend else picture

    return rendering


def burnt(picture: Colours, counts: Counts, palette: Colours) -> Colours:
    """With its legend."""
    shown = picture.copy()
    shown[BAR] = palette[np.linspace(255, 0, BAR[0].stop - BAR[0].start).astype(np.uint8)][:, None]
    low, high = np.quantile(counts, [0.01, 0.99]) * 0.01 - 273.15
    spot = counts[HEIGHT // 2, WIDTH // 2] * 0.01 - 273.15
    for text, at in (
        (f"{high:.1f}", (285, 34)),
        (f"{low:.1f}", (285, 214)),
        (f"{spot:.1f} C", (10, 20)),
        ("THERM", (10, 230)),
    ):
        cv2.putText(shown, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.45, (255, 255, 255), 1, cv2.LINE_AA)
    cv2.drawMarker(shown, (WIDTH // 2, HEIGHT // 2), (255, 255, 255), cv2.MARKER_CROSS, 16, 1)
    return shown
