"""What stands still in the picture while the ground moves: a display burnt in, a logo, dead borders, a leg, dirt on the lens.

The leg and the dirt take light before it reaches the sensor, out of focus; the display is drawn over the finished picture. Of its
readings some change from frame to frame and some do not. The fixed pattern of a thermal sensor is in thermal.py.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from .geometry import CameraState
from .ground.raster import Field, Image

FONT = cv2.FONT_HERSHEY_SIMPLEX
LINE = 1 / 24  # height of a line of writing as a share of the picture's
LEG = np.array([(0.86, 1.02), (0.97, 1.02), (0.935, 0.8), (0.905, 0.8)])  # corners as shares of width and height
LEG_PASSES, SPECK_PASSES = 0.12, 0.7  # share of the light
BLURRED = 1 / 120  # blur of the leg as a share of the picture's height
SPECKS = 0.012, 0.035  # radii as shares of the picture's height
LENS = 19  # seed of the specks


@dataclass(frozen=True, slots=True, kw_only=True)
class Display:
    """bars: share of the picture's height that is dead at the top, and as much at the bottom; specks: of dirt."""

    readings: bool = True
    logo: bool = True
    bars: float = 0.04
    leg: bool = True
    specks: int = 5

    def passed(self, size: tuple[int, int]) -> Field:
        """(h, w): share of the light that reaches the sensor, of a picture of `size` (width, height)."""
        width, height = size
        passed, rng = np.ones((height, width), np.float32), np.random.default_rng(LENS)
        if self.leg:
            cv2.fillPoly(passed, [np.rint(LEG * size).astype(np.int32)], LEG_PASSES, cv2.LINE_AA)
            passed = np.asarray(cv2.GaussianBlur(passed, (0, 0), height * BLURRED), np.float32)
        y, x = np.mgrid[0:height, 0:width].astype(np.float32)
        for _ in range(self.specks):
            at_x, at_y, radius = rng.random() * width, rng.random() * height, rng.uniform(*SPECKS) * height
            away2 = ((x - at_x) ** 2 + (y - at_y) ** 2) / radius**2
            passed *= np.float32(1) - np.float32(1 - SPECK_PASSES) * np.exp(-away2).astype(np.float32)
        return passed

    def burn(self, picture: NDArray[Any], white: NDArray[Any], state: CameraState, index: int) -> None:
        """Draw over a picture (h, w, bands), in place; white: (bands,) counts."""
        height, width = picture.shape[:2]
        ink, rim = np.zeros((height, width), np.uint8), np.zeros((height, width), np.uint8)
        if self.readings:
            cross(ink)
            for thick, layer in ((3, rim), (1, ink)):
                write(layer, readings(state, index), thick)
        if self.logo:
            draw_logo(ink)
        dead = round(self.bars * height)
        picture[rim > 127] = 0
        share = ink[..., None] / np.float32(255)
        picture[:] = np.rint(picture + share * (white.astype(np.float32) - picture)).astype(picture.dtype)
        picture[:dead] = picture[height - dead :] = 0


def readings(state: CameraState, index: int) -> tuple[tuple[str, float, float], ...]:
    """Lines of writing, and the shares of width and height at which they begin."""
    (minutes, seconds), heading = divmod(round(state.time), 60), round(np.degrees(state.yaw)) % 360
    return (
        (f"ALT {state.height:5.1f} M", 0.03, 0.12),
        (f"HDG {heading:03}", 0.03, 0.17),
        ("GPS 3D FIX", 0.03, 0.22),
        (f"REC {minutes:02}:{seconds:02}", 0.4, 0.12),
        (f"BAT {max(0, 100 - index // 4)} %  16.1 V", 0.03, 0.92),
        ("ISO 100  1/800  F2.8", 0.4, 0.92),
    )


def write(layer: Image, lines: Sequence[tuple[str, float, float]], thick: int = 1) -> None:
    """Write lines at shares of width and height on a layer (h, w), in white, in place."""
    height, width = layer.shape
    scale = cv2.getFontScaleFromHeight(FONT, max(6, round(0.6 * LINE * height)))
    for text, x, y in lines:
        cv2.putText(layer, text, (round(x * width), round(y * height)), FONT, scale, 255, thick, cv2.LINE_AA)


def cross(layer: Image) -> None:
    """Draw a cross in the middle of a layer (h, w), in place."""
    height, width = layer.shape
    cv2.drawMarker(layer, (width // 2, height // 2), 255, cv2.MARKER_CROSS, max(12, height // 17), 1)


def draw_logo(layer: Image) -> None:
    """Draw a ring with a bar and a name, top right, on a layer (h, w), in place."""
    height, width = layer.shape
    middle, radius = (round(0.9 * width), round(0.13 * height)), round(0.05 * height)
    cv2.circle(layer, middle, radius, 255, max(1, radius // 5), cv2.LINE_AA)
    cv2.line(
        layer, (middle[0] - radius // 2, middle[1]), (middle[0] + radius // 2, middle[1]), 255, max(1, radius // 4)
    )
    write(layer, (("SITL CAM", 0.83, 0.23),))
