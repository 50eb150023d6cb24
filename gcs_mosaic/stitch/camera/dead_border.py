"""Dead rows and columns at a frame's border: dead sensor lines, letterbox bars, burnt-in status bars.

A line is dead if it stays constant from frame to frame while the ground beside it changes, along a straight edge parallel to
the frame's border. Lines without any visible change beside them (night, black water, a parked vehicle) count as alive. In
reduced frames a dead line is blended with its neighbours: it then changes as they do, but is darker by the same factor in every
frame, which neither ground nor lens causes within one pixel.

Pixel coordinates do not change: a dead border is masked, not cropped.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.stitch.arrays import AnyImage, AnyPointsNx2, Bands, Mask
from gcs_mosaic.stitch.camera.bands import resized

FRAMES = 5  # frames that must agree before a border counts as dead
MOST_FRAMES = 100  # frames examined; whatever is not known by then stays alive
DEEPEST = 4  # a border takes at most this part (a quarter) of the frame's width or height
BLOCKS = 64  # block means per line that are compared between frames
# All in grey levels. A camera's black lines stay within 6 in JPEGs beside bright ground; ground within 2 px of them changes by
# more than 9 from the start and by 20 soon.
CONSTANT = 6.0  # nine tenths of a dead line vary by no more than this over all frames
ALIVE = 12.0  # three quarters of a live line beside it vary by at least this
STEP = 8.0  # difference between the two in one frame, over half their length
TAKEN_BACK = 24.0  # a line thought dead that varies by more than this is alive
DIMMED = 0.85  # of the next line's brightness, at most; a half dead line leaves 0.55, a quarter 0.78
BRIGHT = 40.0  # a line no darker than its neighbour is alive if that one is brighter than this
MARGIN = 1  # lines given up beside the dead ones: JPEG and scaling smear some dead pixels into them

Lines = NDArray[np.float32]  # (lines, blocks), the outermost line first


class DeadBorder(NamedTuple):
    """Number of dead rows and columns on each side of a frame."""

    left: int = 0
    top: int = 0
    right: int = 0
    bottom: int = 0

    def scaled(self, factor: float) -> DeadBorder:
        """For an image scaled by `factor`, including partly affected lines."""
        return DeadBorder(*(math.ceil(lines * factor) for lines in self))

    def limits(self, width: int, height: int) -> tuple[tuple[float, float], tuple[float, float]]:
        """Minimum and maximum (x, y) of the live area of a frame, to the outer edges of its pixels."""
        return (self.left - 0.5, self.top - 0.5), (width - self.right - 0.5, height - self.bottom - 0.5)

    def spares(self, pixels: AnyPointsNx2, width: int, height: int, reach: float = 0.5) -> Mask:
        """Which pixels (n, 2) are at least `reach` px from a dead side. Live sides impose no distance."""
        least, most = self.limits(width, height)
        low = np.where(np.array([self.left, self.top]) > 0, np.array(least) + reach, -np.inf)
        high = np.where(np.array([self.right, self.bottom]) > 0, np.array(most) - reach, np.inf)
        return np.asarray(((pixels >= low) & (pixels <= high)).all(axis=1))

    def filled(self, image: Bands) -> Bands:
        """The image (h, w, bands) with each dead pixel replaced by the nearest live one; unchanged without a dead border."""
        if self == NO_BORDER:
            return image
        height, width = image.shape[:2]
        rows = np.clip(np.arange(height), self.top, height - 1 - self.bottom)
        columns = np.clip(np.arange(width), self.left, width - 1 - self.right)
        filled = image.copy()
        for side in (slice(0, self.top), slice(height - self.bottom, height)):
            filled[side] = image[rows[side]]
        for side in (slice(0, self.left), slice(width - self.right, width)):
            filled[:, side] = filled[:, columns[side]]
        return filled


NO_BORDER = DeadBorder()


@dataclass(frozen=True, slots=True, eq=False)
class _Evidence:
    """Observations of the lines along one side: range of each block, number of frames in which a line differs from the live line
    beside it, number of frames with a dimmed outermost line, and whether it was ever not dimmed."""

    frames: int
    low: Lines
    high: Lines
    steps: NDArray[np.int32]
    dimmed: int = 0
    undimmed: bool = False

    def after(self, lines: Lines) -> _Evidence:
        outermost, following = float(lines[0].mean()), float(lines[1].mean())
        darker = outermost < DIMMED * following
        return _Evidence(
            self.frames + 1,
            np.minimum(self.low, lines),
            np.maximum(self.high, lines),
            self.steps + _steps(lines),
            self.dimmed + (darker and following - outermost >= STEP),
            self.undimmed or (not darker and following >= BRIGHT),
        )

    @property
    def is_dimmed(self) -> bool:
        return self.dimmed >= FRAMES and not self.undimmed

    def constant(self, tolerance: float) -> int:
        """Number of constant lines, counted from the outermost."""
        changing = np.quantile(self.high - self.low, 0.9, axis=1) > tolerance
        return int(changing.argmax()) if changing.any() else len(changing)

    def dead(self) -> int:
        """Number of lines dead according to the evidence so far."""
        if self.is_dimmed:
            return 1 + MARGIN
        lines = self.constant(CONSTANT)
        # In most frames, not some: the edge of black water comes and goes, however straight the quay.
        if not 0 < lines < len(self.steps) or self.steps[lines - 1] < max(FRAMES, self.frames / 2):
            return 0
        beside = (self.high - self.low)[lines + MARGIN]
        return lines + MARGIN if np.quantile(beside, 0.25) >= ALIVE else 0


def _steps(lines: Lines) -> NDArray[np.int32]:
    """1 for each line that differs from what would be the first live line if it were the last dead one."""
    apart = np.abs(lines[1 + MARGIN :] - lines[: -1 - MARGIN])
    return np.asarray(np.median(apart, axis=1) >= STEP, dtype=np.int32)


@dataclass(frozen=True, slots=True)
class _Side:
    """Number of dead lines on a side. `evidence` is None before the first frame and once settled."""

    dead: int = 0
    settled: bool = False
    evidence: _Evidence | None = None

    def after(self, lines: Lines) -> _Side:
        """After one more frame. A dead side may turn out alive once, never the other way round."""
        if len(lines) < 2 * (1 + MARGIN):
            return _Side(settled=True)
        evidence = (self.evidence or _no_evidence(lines)).after(lines)
        if self.dead:
            is_alive = not evidence.is_dimmed and evidence.constant(TAKEN_BACK) < self.dead - MARGIN
        else:
            is_alive = evidence.undimmed and not evidence.constant(CONSTANT)
        if is_alive:
            return _Side(settled=True)
        dead = self.dead or (evidence.dead() if evidence.frames >= FRAMES else 0)
        settled = evidence.frames == MOST_FRAMES
        return _Side(dead, settled, None if settled else evidence)


def _no_evidence(lines: Lines) -> _Evidence:
    steps = np.zeros(len(lines) - 1 - MARGIN, np.int32)
    return _Evidence(0, np.full_like(lines, np.inf), np.full_like(lines, -np.inf), steps)


@dataclass(frozen=True, slots=True)
class BorderWatch:
    """Dead border of frames of one size, from those seen so far; immutable."""

    _sides: tuple[_Side, _Side, _Side, _Side] = (_Side(), _Side(), _Side(), _Side())

    @property
    def border(self) -> DeadBorder:
        return DeadBorder(*(side.dead for side in self._sides))

    def after(self, image: Bands, levels: Callable[[Bands], AnyImage]) -> BorderWatch:
        """After one more frame (h, w, bands); `levels` maps its bands to display levels, black 0, white 255."""
        left, top, right, bottom = (
            side if side.settled else side.after(_lines_along(image, number, levels))
            for number, side in enumerate(self._sides)
        )
        return BorderWatch((left, top, right, bottom))

    def anew(self) -> BorderWatch:
        """When frames have other levels from now on: sides known to be dead stay so, the others are watched from the start."""
        left, top, right, bottom = (_Side(side.dead, settled=True) if side.dead else _Side() for side in self._sides)
        return BorderWatch((left, top, right, bottom))


def _lines_along(image: Bands, side: int, levels: Callable[[Bands], AnyImage]) -> Lines:
    """Lines along one side (left, top, right or bottom), from the border inwards, as means of the bands' levels."""
    height, width = image.shape[:2]
    rows, columns = max(1, height // DEEPEST), max(1, width // DEEPEST)
    part = (image[:, :columns], image[:rows], image[:, -columns:], image[-rows:])[side]
    size = (min(BLOCKS, width), rows) if side % 2 else (columns, min(BLOCKS, height))
    seen = np.asarray(levels(resized(part, size)).mean(axis=2, dtype=np.float32))
    inwards = seen if side % 2 else seen.T
    return inwards if side < 2 else inwards[::-1]
