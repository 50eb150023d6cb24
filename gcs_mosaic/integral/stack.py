"""Looks at a window of the ground, laid on one plane."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from gcs_mosaic.integral.focal_plane import pixels_at
from gcs_mosaic.render.dense_places import STEP, between_steps, sampled
from gcs_mosaic.stitch.arrays import FloatImage, Lattice, Mask, PointsNx2, Vector
from gcs_mosaic.stitch.camera.dead_border import NO_BORDER, DeadBorder
from gcs_mosaic.stitch.camera.geometry import Camera, Pose
from gcs_mosaic.stitch.camera.relief import ReliefDisplacement
from gcs_mosaic.stitch.camera.still_mask import StillMask


@dataclass(frozen=True, slots=True)
class GroundWindow:
    """A square of the canvas about (x, y), `side` canvas units wide, of cells x cells pixels."""

    x: float
    y: float
    side: float
    cells: int

    @property
    def cell(self) -> float:
        """Canvas units of a pixel."""
        return self.side / self.cells

    def lattice(self) -> tuple[PointsNx2, int]:
        """Canvas places at the corners of blocks of STEP cells, row by row, and how many there are along a side."""
        count = -(-self.cells // STEP) + 1
        along = np.arange(count) * (STEP * self.cell) - self.side / 2
        x, y = np.meshgrid(self.x + along, self.y + along)
        return np.column_stack([x.ravel(), y.ravel()]), count

    def place_of(self, column: float, row: float) -> tuple[float, float]:
        """Canvas place of a pixel's centre."""
        left, top = self.x - self.side / 2, self.y - self.side / 2
        return left + (column + 0.5) * self.cell, top + (row + 0.5) * self.cell


@dataclass(frozen=True, slots=True, eq=False)
class GroundLook:
    """A part of a frame in memory, and where that was taken from.

    `image`: (h, w, bands) grey levels of one light in all looks; its pixels are `reduction` pixels of `camera`'s frame wide, and
    its left and upper edges lie at `left`, `top` of that frame, counted from the frame's own edges.
    """

    name: str
    pose: Pose
    camera: Camera
    image: FloatImage
    relief: ReliefDisplacement | None = None
    left: float = 0.0
    top: float = 0.0
    reduction: float = 1.0
    dead: DeadBorder = NO_BORDER
    still: StillMask | None = None


@dataclass(frozen=True, slots=True, eq=False)
class LookStack:
    """What each look shows of a window if all that it sees lay on the plane: (looks, h, w, bands), NaN where it sees nothing."""

    names: Sequence[str]
    values: FloatImage


def laid_together(looks: Sequence[GroundLook], window: GroundWindow, height: float) -> LookStack:
    """Looks that see some of the window, on the plane at a height in canvas units above the ground."""
    names, values = [], []
    for look in looks:
        shown = laid(look, window, height)
        if shown is not None:
            names.append(look.name)
            values.append(shown)
    bands = looks[0].image.shape[2] if looks else 1
    nothing = np.empty((0, window.cells, window.cells, bands), np.float32)
    return LookStack(names, np.stack(values) if values else nothing)


def laid(look: GroundLook, window: GroundWindow, height: float | Vector) -> FloatImage | None:
    """(cells, cells, bands) of one look, NaN where it sees nothing; None if it sees nothing at all. `height`: one for all, or
    (n,) of the lattice's places."""
    at = _places(look, window, height)
    seen = _seen(look, at)
    if not seen.any():
        return None
    values = np.asarray(sampled(look.image, at), np.float32)
    if not seen.all():
        values[~seen] = np.nan
    return values


def _places(look: GroundLook, window: GroundWindow, height: float | Vector) -> Lattice:
    """Pixels (cells, cells, 2) of the look's image at the window's pixels; NaN where its lens cannot see them."""
    places, count = window.lattice()
    pixels = pixels_at(look.pose, look.camera, look.relief, places, height)
    exact = ((pixels + 0.5 - [look.left, look.top]) / look.reduction - 0.5).reshape(count, count, 2)
    return between_steps(exact, window.cells, window.cells)


def _seen(look: GroundLook, at: Lattice) -> Mask:
    """Where the frame, and what of it is in memory, shows something (h, w), by pixels of the image (h, w, 2)."""
    low, high = look.dead.limits(look.camera.width, look.camera.height)
    corner, rows_columns = np.array([look.left, look.top]), look.image.shape[:2]
    least = np.maximum((np.array(low) + 0.5 - corner) / look.reduction - 0.5, -0.5)
    most = np.minimum((np.array(high) + 0.5 - corner) / look.reduction - 0.5, np.array(rows_columns[::-1]) - 0.5)
    seen = np.asarray(cv2.inRange(at, tuple(least.tolist()), tuple(most.tolist())) > 0)
    if look.still is not None and seen.any():
        rows, columns = np.nonzero(seen)
        pixels = (at[rows, columns] + 0.5) * look.reduction + corner - 0.5
        seen[rows, columns] = ~look.still.covers(pixels, look.camera.width, look.camera.height)
    return seen
