"""Model of a cheap thermal camera: low contrast, and fixed-pattern noise in every frame.

The pattern belongs to the camera: sensor columns and rows, a cold rim, dirt on the window, an overlay. What a colour camera has
of the kind is in display.py.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from .display import cross
from .ground.raster import Field, Image
from .sensor import LUMINANCE


@dataclass(frozen=True, slots=True, kw_only=True)
class ThermalCamera:
    """make: seed of the pattern. contrast: of the ground, relative to the input picture; others in grey levels of 255."""

    make: int = 1
    contrast: float = 0.25
    level: float = 105.0
    rim: float = -45.0  # offset of the corners from the centre
    grid: float = 1.5  # standard deviation of column and row offsets
    dirt: float = 24.0  # darkening under a spot
    spots: int = 12
    noise: float = 1.0  # standard deviation of the temporal noise
    writing: bool = True

    def picture(self, seen: Image, index: int) -> Image:
        """(h, w, 3) BGR -> (h, w) thermal picture; `index` seeds the frame's noise."""
        height, width = seen.shape[:2]
        warm = np.asarray(cv2.GaussianBlur(seen @ LUMINANCE[0], (0, 0), 1.2), np.float32)
        rng = np.random.default_rng([self.make, 18, index])
        noise = self.noise * rng.standard_normal((height, width), np.float32)
        grey = self.level + self.contrast * (warm - warm.mean()) + self.pattern((width, height)) + noise
        picture = np.asarray(np.clip(grey + 0.5, 0, 255), np.uint8)
        if self.writing:
            write(picture)
        return picture

    def pattern(self, size: tuple[int, int]) -> Field:
        """(h, w): the fixed pattern, without the overlay."""
        width, height = size
        rng = np.random.default_rng([self.make, 17])
        y, x = np.mgrid[0:height, 0:width].astype(np.float32)
        radius = np.hypot(x - width / 2, y - height / 2) / np.hypot(width / 2, height / 2)
        pattern = self.rim * radius**3 + self.grid * rng.standard_normal((1, width)).astype(np.float32)
        pattern = pattern + self.grid * rng.standard_normal((height, 1)).astype(np.float32)
        pattern += self.grid * (((x // 8) + (y // 8)) % 2)
        for at_x, at_y, large in rng.uniform((0, 0, 3), (width, height, 14), (self.spots, 3)).astype(np.float32):
            pattern -= self.dirt * np.exp(-0.5 * (((x - at_x) ** 2 + (y - at_y) ** 2) / (large / 2) ** 2))
        return np.asarray(pattern, np.float32)


def write(picture: Image) -> None:
    """Draw the overlay in place: range, emissivity, a scale bar and a centre cross."""
    height, width = picture.shape
    for line, text in enumerate(("MAX 34.6C", "MIN 11.2C", "e=0.95")):
        cv2.putText(picture, text, (12, 24 + 20 * line), cv2.FONT_HERSHEY_SIMPLEX, 0.5, 255, 1, cv2.LINE_AA)
    cv2.putText(picture, "HDG 271  ALT 60", (12, height - 14), cv2.FONT_HERSHEY_SIMPLEX, 0.5, 255, 1, cv2.LINE_AA)
    bar = np.linspace(255, 0, height // 2).astype(np.uint8)[:, None]
    picture[height // 4 : height // 4 + len(bar), width - 26 : width - 14] = bar
    cross(picture)
