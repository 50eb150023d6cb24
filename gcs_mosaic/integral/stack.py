"""Looks at a window of the ground, laid on one plane."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from gcs_mosaic.integral.focal_plane import pixels_at
from gcs_mosaic.render.dense_places import NOWHERE, STEP, between_steps, sampled
from gcs_mosaic.stitch.arrays import Array, FloatImage, Lattice, Mask, PointsNx2, Vector
from gcs_mosaic.stitch.camera.dead_border import NO_BORDER, DeadBorder
from gcs_mosaic.stitch.camera.geometry import Camera, Pose
from gcs_mosaic.stitch.camera.picture_area import PictureArea
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
    its left and upper edges lie at `left`, `top` of that frame, counted from the frame's own edges. `heat`: its colours are
    those of a palette that is brighter where it is warmer.
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
    area: PictureArea | None = None
    heat: bool = False


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
    part = laid_part(look, window, height)
    if part is None:
        return None
    if not part.seen.all():
        part.values[~part.seen] = np.nan
    if part.seen.shape == (window.cells, window.cells):
        return part.values
    found = np.full((window.cells, window.cells, look.image.shape[2]), np.nan, np.float32)
    found[part.where] = part.values
    return found


@dataclass(frozen=True, slots=True, eq=False)
class LaidPart:
    """What a look shows of the rows and columns (`where`) of a window that it may see: `values` (h, w, bands), which count only
    where it has `seen` something (h, w)."""

    where: tuple[slice, slice]
    values: FloatImage
    seen: Mask


def laid_part(look: GroundLook, window: GroundWindow, height: float | Vector) -> LaidPart | None:
    """As `laid`, without what lies beside the look; None if it sees nothing at all."""
    places, count = window.lattice()
    pixels = pixels_at(look.pose, look.camera, look.relief, places, height)
    exact = ((pixels + 0.5 - [look.left, look.top]) / look.reduction - 0.5).reshape(count, count, 2)
    blocks = _blocks_seen(look, exact)
    if blocks is None:
        return None
    (top, bottom), (left, right) = blocks
    rows, columns = (min(last * STEP, window.cells) - first * STEP for first, last in blocks)
    at = between_steps(exact[top : bottom + 1, left : right + 1], rows, columns)
    seen = _seen(look, at)
    if not seen.any():
        return None
    where = np.s_[top * STEP : top * STEP + rows, left * STEP : left * STEP + columns]
    return LaidPart(where, np.asarray(sampled(look.image, at), np.float32), seen)


def _blocks_seen(look: GroundLook, exact: Array) -> tuple[tuple[int, int], tuple[int, int]] | None:
    """First and last but one rows and columns of the blocks between pixels of the look's image (down, across, 2) that it may
    see, one more on each side; None without any. Pixels are NaN where the lens cannot see them."""
    height, width = look.image.shape[:2]
    with np.errstate(invalid="ignore"):
        low = _of_blocks(np.minimum, exact) <= [width, height]
        high = _of_blocks(np.maximum, exact) >= -1
    inside: Mask = np.asarray((low & high).all(axis=2))
    if not inside.any():
        return None
    found = [np.flatnonzero(np.any(inside, axis=axis)) for axis in (1, 0)]
    ends = [
        (max(int(one[0]) - 1, 0), min(int(one[-1]) + 2, size)) for one, size in zip(found, inside.shape, strict=True)
    ]
    return ends[0], ends[1]


def _of_blocks(extreme: np.ufunc, exact: Array) -> Array:
    """The extreme of the four corners of each block; NaN if one is."""
    return np.asarray(extreme.reduce([exact[:-1, :-1], exact[1:, :-1], exact[:-1, 1:], exact[1:, 1:]]))


def _seen(look: GroundLook, at: Lattice) -> Mask:
    """Where the frame, and what of it is in memory, shows something (h, w), by pixels of the image (h, w, 2)."""
    low, high = look.dead.limits(look.camera.width, look.camera.height)
    corner, (height, width) = np.array([look.left, look.top]), look.image.shape[:2]
    least = np.maximum((np.array(low) + 0.5 - corner) / look.reduction - 0.5, -0.5)
    most = np.minimum((np.array(high) + 0.5 - corner) / look.reduction - 0.5, np.array([width, height]) - 0.5)
    seen = np.asarray(cv2.inRange(at, tuple(least.tolist()), tuple(most.tolist())) > 0)
    if look.still is not None and look.still.blocks.any():
        seen &= _uncovered(look.still, look, at)
    if look.area is not None:
        pixels = (at.reshape(-1, 2) + 0.5) * look.reduction + corner - 0.5
        depth = look.area.depth(pixels, look.camera.width, look.camera.height)
        seen &= depth.reshape(seen.shape) > 0
    return seen


def _uncovered(still: StillMask, look: GroundLook, at: Lattice) -> Mask:
    """Where no overlay covers the frame (h, w), by pixels of the look's image (h, w, 2); anything where these are NaN."""
    blocks = np.where(still.blocks, 0, 255).astype(np.uint8)
    size = np.array([still.columns / look.camera.width, still.rows / look.camera.height])
    first = (np.array([look.left, look.top]) + 0.5 * look.reduction) * size - 0.5
    of_blocks = np.asarray(at * (look.reduction * size) + first, np.float32)
    cv2.patchNaNs(of_blocks, NOWHERE)
    found = cv2.remap(blocks, of_blocks, None, cv2.INTER_NEAREST, borderMode=cv2.BORDER_REPLICATE)  # type: ignore[call-overload]
    return np.asarray(found > 0)
