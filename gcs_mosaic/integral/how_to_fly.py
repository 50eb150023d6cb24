"""How to fly for a wanted number of looks: spacing along and across, and what speed that allows."""

from __future__ import annotations

import math
from dataclasses import dataclass

from gcs_mosaic.errors import UsageError

# A third of them across: looks along a line share the line's gaps between crowns, and a blur along it.
ACROSS = 3
MOST_BLUR = 0.5  # px of motion within an exposure


@dataclass(frozen=True, slots=True, kw_only=True)
class FlyingWish:
    """`fov_deg`: across the picture's longer side; `aspect`: longer by shorter side; `pixels`: of the longer side."""

    looks: int
    height_m: float
    fov_deg: float
    aspect: float
    pixels: int
    interval_s: float
    exposure_s: float


@dataclass(frozen=True, slots=True)
class LookPattern:
    """So many frames along a line show each place, from each of so many lines."""

    along: int
    lines: int

    @property
    def looks(self) -> int:
        return self.along * self.lines

    @property
    def forward(self) -> float:
        """Overlap of consecutive frames of a line, as a share."""
        return 1 - 1 / self.along

    @property
    def side(self) -> float:
        """Overlap of neighbouring lines, as a share."""
        return 1 - 1 / self.lines


def pattern_for(looks: int) -> LookPattern:
    """That with which each place is seen by so many frames or more."""
    lines = ACROSS if looks >= 2 * ACROSS else 1
    return LookPattern(math.ceil(looks / lines), lines)


def flying_words(wish: FlyingWish) -> str:
    """What to fly, in words. Raises UsageError for what no camera does."""
    if not (
        wish.looks >= 2
        and wish.height_m > 0
        and 1 <= wish.fov_deg <= 150
        and wish.aspect >= 1
        and wish.pixels >= 16
        and wish.interval_s > 0
        and wish.exposure_s > 0
    ):
        raise UsageError(
            "Give two looks or more, a field of view from 1 to 150 degrees, an aspect of 1 or more, 16 pixels or more, and "
            "heights and times above 0."
        )
    long_m = 2 * wish.height_m * math.tan(math.radians(wish.fov_deg) / 2)
    short_m, gsd = long_m / wish.aspect, long_m / wish.pixels
    pattern = pattern_for(wish.looks)
    step, spacing = short_m / pattern.along, long_m / pattern.lines
    by_camera, by_blur = step / wish.interval_s, MOST_BLUR * gsd / wish.exposure_s
    limit = "the camera's interval" if by_camera <= by_blur else "motion blur"
    angle = 2 * math.degrees(math.atan(0.5 * math.hypot(long_m * pattern.side, short_m) / wish.height_m))
    return (
        f"a frame every {step:.1f} m along, lines {spacing:.1f} m apart: {pattern.looks} looks at each place, "
        f"{angle:.0f} degrees between the outermost; at most {min(by_camera, by_blur):.1f} m/s, by {limit}; "
        f"pixels of {100 * gsd:.1f} cm on the ground; at most {wish.height_m * gsd / math.hypot(long_m, short_m):.2f} m of "
        "error in the height of the focus blur a point by a pixel"
    )
