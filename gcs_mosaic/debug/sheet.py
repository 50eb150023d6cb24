"""A sheet to draw on with OpenCV: antialiased lines, arrows and text at subpixel positions.

Everything is drawn at twice the size and reduced at the end. Colours are BGR; positions are pixels of the final picture, x
right, y down.
"""

from __future__ import annotations

from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.stitch.arrays import ImageBGR, PointsNx2, Vector, Vector2

Colour = tuple[float, float, float]
Anchor = Literal["left", "middle", "right"]

PAPER: Colour = (250, 250, 250)
INK: Colour = (60, 50, 45)
FAINT: Colour = (215, 212, 208)
GOOD: Colour = (80, 175, 60)
BAD: Colour = (60, 60, 225)

OVERSAMPLING = 2
FRACTION_BITS = 4  # of a pixel, in OpenCV's fixed-point coordinates
FONT = cv2.FONT_HERSHEY_SIMPLEX
LETTER_HEIGHT = 30.0  # px of FONT at scale 1, from descender to ascender
ARROW_HEAD, LONGEST_HEAD = 0.3, 10.0  # of an arrow's length, and px


class Sheet:
    """A picture under construction; `picture` returns its present state."""

    def __init__(self, width: int, height: int, paper: Colour = PAPER) -> None:
        self.width, self.height = width, height
        self._pixels = np.full((height * OVERSAMPLING, width * OVERSAMPLING, 3), paper, np.uint8)

    def picture(self) -> ImageBGR:
        """(height, width, 3) BGR."""
        return np.asarray(cv2.resize(self._pixels, (self.width, self.height), interpolation=cv2.INTER_AREA), np.uint8)

    def lines(self, points: PointsNx2, colour: Colour, width: float = 1.0, *, closed: bool = False) -> None:
        """A polyline through points (n, 2); NaN breaks it."""
        seen = np.isfinite(points).all(axis=1)
        if closed and seen.all():
            self._polylines(points, colour, width, closed=True)
            return
        for part in np.split(points, np.flatnonzero(~seen)):
            part = part[np.isfinite(part).all(axis=1)]
            if len(part) > 1:
                self._polylines(part, colour, width, closed=False)

    def fill(self, outline: PointsNx2, colour: Colour, opacity: float) -> None:
        """A tinted polygon (n, 2)."""
        corners = _fixed(outline)
        left, top, width, height = cv2.boundingRect(corners >> FRACTION_BITS)
        left, top = max(0, left - 1), max(0, top - 1)  # a line's antialiased edge extends a pixel farther
        part = self._pixels[top : top + height + 3, left : left + width + 3]
        if part.size:
            tinted = part.copy()
            inside = corners - (np.array([left, top], np.int32) << FRACTION_BITS)
            cv2.fillPoly(tinted, [inside], colour, cv2.LINE_AA, FRACTION_BITS)
            part[:] = cv2.addWeighted(tinted, opacity, part, 1 - opacity, 0)

    def arrow(self, start: Vector2, end: Vector2, colour: Colour, width: float = 1.0) -> None:
        """An arrow from start (2,) to end (2,); nothing if either is NaN."""
        if not np.isfinite([start, end]).all():
            return
        along = (end - start) * min(ARROW_HEAD, LONGEST_HEAD / max(float(np.linalg.norm(end - start)), 1e-9))
        across = np.array([-along[1], along[0]]) * 0.5
        self._polylines(np.array([start, end]), colour, width, closed=False)
        self._polylines(np.array([end - along + across, end, end - along - across]), colour, width, closed=False)

    def dot(self, at: Vector2, radius: float, colour: Colour) -> None:
        x, y = _fixed(at[None])[0].tolist()
        cv2.circle(self._pixels, (x, y), round(radius * OVERSAMPLING * 2**FRACTION_BITS), colour, cv2.FILLED, cv2.LINE_AA,
                   FRACTION_BITS)  # fmt: skip

    def words(self, at: tuple[float, float], said: str, colour: Colour = INK, size: float = 14.0, anchor: Anchor = "left",
              halo: Colour | None = None) -> None:  # fmt: skip
        """One line of ASCII; `at`: left end, middle or right end of its baseline, `size`: height of its letters in px."""
        scale = size * OVERSAMPLING / LETTER_HEIGHT
        weight = max(1, round(size * OVERSAMPLING / 14))
        width = cv2.getTextSize(said, FONT, scale, weight)[0][0]
        x = at[0] * OVERSAMPLING - width * {"left": 0.0, "middle": 0.5, "right": 1.0}[anchor]
        foot = round(x), round(at[1] * OVERSAMPLING)
        if halo:
            cv2.putText(self._pixels, said, foot, FONT, scale, halo, 3 * weight, cv2.LINE_AA)
        cv2.putText(self._pixels, said, foot, FONT, scale, colour, weight, cv2.LINE_AA)

    def paste(self, image: ImageBGR, x: int, y: int) -> None:
        """An image (h, w, 3) with its top left corner at (x, y); it must lie within the sheet."""
        height, width = (side * OVERSAMPLING for side in image.shape[:2])
        enlarged = cv2.resize(image, (width, height), interpolation=cv2.INTER_LINEAR)
        self._pixels[y * OVERSAMPLING : y * OVERSAMPLING + height, x * OVERSAMPLING : x * OVERSAMPLING + width] = (
            enlarged
        )

    def _polylines(self, points: PointsNx2, colour: Colour, width: float, *, closed: bool) -> None:
        thickness = max(1, round(width * OVERSAMPLING))
        cv2.polylines(self._pixels, [_fixed(points)], closed, colour, thickness, cv2.LINE_AA, FRACTION_BITS)


def rainbow(shares: Vector) -> list[Colour]:
    """A colour for each share (n,) from 0 (blue) to 1 (red), neither too light for the paper nor too dark for the ink."""
    steps = np.clip(15 + np.nan_to_num(shares) * 225, 15, 240).astype(np.uint8)
    colours = cv2.applyColorMap(steps.reshape(-1, 1), cv2.COLORMAP_TURBO).reshape(-1, 3) * 0.85
    return [(float(b), float(g), float(r)) for b, g, r in colours]


def nice_length(longest: float) -> float:
    """The largest of 1, 2, 5, 10, ... (and 0.1, 0.2, ...) not above `longest`."""
    power = 10.0 ** np.floor(np.log10(longest))
    return float(next(step * power for step in (5, 2, 1) if step * power <= longest * (1 + 1e-9)))


def _fixed(points: PointsNx2) -> NDArray[np.int32]:
    """Positions in OpenCV's fixed-point coordinates; the centre of the first pixel is 0."""
    fine = ((points + 0.5) * OVERSAMPLING - 0.5) * 2**FRACTION_BITS
    return np.asarray(np.rint(np.clip(fine, -1e8, 1e8)), np.int32)
