"""A frame's maps sampled at the cells of tiles."""

from __future__ import annotations

import cv2
import numpy as np

from gcs_mosaic.render.cells import PARTLY, WHOLLY, Window
from gcs_mosaic.render.warp import NOWHERE, refined
from gcs_mosaic.render.warp_grid import LATTICE, FrameLattice, times_each
from gcs_mosaic.stitch.arrays import AnyImage, CellFlags, Lattice

# Penalty on a frame's score where it only partly covers a cell: exceeds all else, so it shows only where no other frame does.
CUT = 1000.0
UNDER_OVERLAY = 500.0  # the same where an overlay covers the ground; where a frame is cut it shows nothing at all


def lattice_part(lattice: FrameLattice, window: Window) -> tuple[slice, slice]:
    """Rows and columns of the lattice points of a window of the lattice's tiles."""
    points = LATTICE - 1
    y, x = (window.top - lattice.first.y) * points, (window.left - lattice.first.x) * points
    height, width = window.bottom - window.top + 1, window.right - window.left + 1
    return slice(y, y + height * points + 1), slice(x, x + width * points + 1)


def at_cells(values: Lattice) -> Lattice:
    """Values at lattice points (n + 1, m + 1[, k]), bilinear at the centres of cells (2 n, 2 m[, k])."""
    rows, columns = values.shape[0] - 1, values.shape[1] - 1
    between = np.empty((2 * rows, columns + 1, *values.shape[2:]), np.float32)
    far, near = values * np.float32(0.25), values * np.float32(0.75)
    np.add(near[:-1], far[1:], out=between[::2])
    np.add(far[:-1], near[1:], out=between[1::2])
    cells = np.empty((2 * rows, 2 * columns, *values.shape[2:]), np.float32)
    far, near = between * np.float32(0.25), between * np.float32(0.75)
    np.add(near[:, :-1], far[:, 1:], out=cells[:, ::2])
    np.add(far[:, :-1], near[:, 1:], out=cells[:, 1::2])
    return cells


def at_middles(values: Lattice) -> Lattice:
    """Values at lattice points (n + 1, m + 1[, k]), at the centres between them (n, m[, k])."""
    rows = values[:-1] + values[1:]
    return np.asarray((rows[:, :-1] + rows[:, 1:]) * np.float32(0.25))


def inside(lattice: FrameLattice, where: tuple[slice, slice]) -> CellFlags:
    """How far the cells (h, w) between these lattice points lie within the painted part of the frame: 0, `PARTLY` or `WHOLLY`.

    Frame pixels within a cell lie between those of its corners, so a cell with all corners inside is inside.
    """
    (left, top), (right, bottom) = lattice.limits
    x, y = np.ascontiguousarray(np.moveaxis(refined(lattice.pixels[where]), 2, 0))
    with np.errstate(invalid="ignore"):
        least_x, most_x, least_y, most_y = (of(c) for c in (x, y) for of in (_least, _most))
        wholly = (least_x > left) & (most_x < right) & (least_y > top) & (most_y < bottom)
        partly = (most_x > left) & (least_x < right) & (most_y > top) & (least_y < bottom)
    if lattice.useful is not None:
        useful = refined(lattice.useful[where])
        wholly &= _least(useful) > 0
        partly &= _most(useful) > 0
    return np.where(wholly, np.uint8(WHOLLY), partly * np.uint8(PARTLY))


def hindrance(lattice: FrameLattice, where: tuple[slice, slice], covered: CellFlags) -> Lattice:
    """Penalty on the frame's score in the cells (h, w) between these lattice points; `covered`: how far they lie `inside`."""
    cut = np.asarray(np.float32(CUT) * (covered == PARTLY), np.float32)
    if lattice.covered is None:
        return cut
    return np.asarray(cut + np.float32(UNDER_OVERLAY) * (at_cells(lattice.covered[where]) > 0), np.float32)


def _least(points: Lattice) -> Lattice:
    rows = np.minimum(points[:-1], points[1:])
    return np.minimum(rows[:, :-1], rows[:, 1:])


def _most(points: Lattice) -> Lattice:
    rows = np.maximum(points[:-1], points[1:])
    return np.maximum(rows[:, :-1], rows[:, 1:])


def places_in(pixels: Lattice, lattice: FrameLattice, shape: tuple[int, ...]) -> Lattice:
    """Places in a map (rows, columns, ...) of the whole frame, of frame pixels (h, w, 2)."""
    scale = shape[1] / lattice.camera.width, shape[0] / lattice.camera.height
    places = times_each(pixels + np.float32(0.5), scale)
    places -= np.float32(0.5)
    np.copyto(places, np.float32(NOWHERE), where=np.isnan(places))
    return places


def sampled(values: AnyImage, places: Lattice) -> AnyImage:
    """A map (rows, columns[, up to 4]) at places (h, w, 2) in it, bilinear. Independent of where a window of places begins."""
    return np.asarray(cv2.remap(values, places, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))  # type: ignore
