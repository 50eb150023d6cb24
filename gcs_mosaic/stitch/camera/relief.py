"""Relief displacement: how far terrain height shifts the points of a frame, and its correction.

On a plane, pose and lens determine where every pixel lies. Roofs and hills appear displaced away from the nadir point,
differently in every frame. Each frame therefore has a coarse grid of shifts: a pixel, moved by the shift at its place, is where
the camera would have seen the same ground on a plane. The grid also absorbs other smooth model errors (rolling shutter, lens
terms beyond the two modelled).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.stitch.arrays import FloatImage, Mask, PointsNx2, ShiftGrid
from gcs_mosaic.stitch.camera.geometry import Camera

STEPS = 12  # of the fixed-point iteration that inverts the shifts
CONVERGED_PX = 0.01  # length of a step of it after which a point is done
EVENED = 200  # rounds of evening out what is steeper than
EVEN_ENOUGH = 1.01  # of it: the rest is scaled down
STEEPEST = 0.25  # maximum change of the shift per cell: no place is seen twice, and the inversion converges


@dataclass(frozen=True, slots=True, kw_only=True)
class ReliefSettings:
    """How terrain height is modelled."""

    sigma: float = 0.04  # expected standard deviation of heights about the plane, in flying heights
    cells: int = 32  # of a frame's grid along its longer side; 0 disables relief displacement
    stiffness: float = 2.0  # resistance of the ground to steps between cells, relative to one track
    step_px: float = 1.0  # a step by which it gives way, as at the foot of a wall; pixels of the feature picture
    rest_stiffness: float = 0.3  # of what heights do not explain, relative to one track
    tie: float = 0.0002  # pull of the grid towards zero, and of heights towards the frame's middle one
    loss_px: float = 1.0  # Cauchy loss scale for outlying points, in pixels of the feature picture
    largest: float = 0.3  # largest shift accepted, half-diagonals


@dataclass(frozen=True, slots=True)
class ReliefDisplacement:
    """Shifts at the nodes of a grid over a frame, bilinear in between.

    `shifts`: (rows, columns, 2) float32 in half-diagonals, as bytes, so that displacements compare and store bit by bit; the
    outermost nodes are the outermost pixel centres.
    """

    columns: int
    rows: int
    shifts: bytes

    @classmethod
    def from_grid(cls, grid: ShiftGrid) -> ReliefDisplacement:
        """From shifts (rows, columns, 2) in half-diagonals; evened out where they would fold the image."""
        rows, columns = grid.shape[:2]
        cell = 2 / np.hypot(columns - 1, rows - 1)  # half-diagonals, for a grid with the frame's aspect ratio
        return cls(columns, rows, _without_folds(grid, STEEPEST * cell).astype(np.float32).tobytes())

    @property
    def grid(self) -> FloatImage:
        """The shifts (rows, columns, 2) in half-diagonals."""
        return np.frombuffer(self.shifts, np.float32).reshape(self.rows, self.columns, 2)

    def at(self, camera: Camera, pixels: PointsNx2) -> PointsNx2:
        """Shifts (n, 2) in pixels at pixels (n, 2); outside the frame, those of its border."""
        across, down = (
            np.minimum(np.fmax(pixels[:, k] * ((nodes - 1) / max(size - 1, 1)), 0), nodes - 1)  # NaN becomes 0
            for k, (size, nodes) in enumerate(((camera.width, self.columns), (camera.height, self.rows)))
        )
        nodes = _nodes(self, camera.half_diagonal)
        column, row = across.astype(np.intp), down.astype(np.intp)
        right, below, corner = across - column, down - row, row * (self.columns + 1) + column
        upper = nodes[corner] * (1 - right) + nodes[corner + 1] * right
        corner += self.columns + 1
        lower = nodes[corner] * (1 - right) + nodes[corner + 1] * right
        shifts = upper * (1 - below) + lower * below
        return np.asarray(shifts.view(np.float64).reshape(-1, 2))


def _without_folds(grid: ShiftGrid, steepest: float) -> ShiftGrid:
    """The grid (rows, columns, 2) with no two neighbours farther apart than `steepest` along either axis: those that are
    approach each other, round by round, and whatever is left is scaled down with all."""
    grid = grid.copy()
    for _ in range(EVENED):
        steps = [np.diff(grid, axis=axis) for axis in (0, 1)]
        if max(np.abs(some).max(initial=0.0) for some in steps) < EVEN_ENOUGH * steepest:
            break
        down, across = (some - np.clip(some, -steepest, steepest) for some in steps)
        grid[:-1] += down / 4  # each node has four neighbours
        grid[1:] -= down / 4
        grid[:, :-1] += across / 4
        grid[:, 1:] -= across / 4
    left = max(np.abs(np.diff(grid, axis=axis)).max(initial=0.0) for axis in (0, 1))
    return np.asarray(grid * min(1.0, steepest / max(left, 1e-12)))


@lru_cache(maxsize=256)
def _nodes(relief: ReliefDisplacement, half_diagonal: float) -> NDArray[np.complex128]:
    """Shifts in pixels, with one more row and column than there are, the last once more. As complex numbers x and y are fetched
    from memory together."""
    nodes = relief.grid.astype(np.float64).view(np.complex128)[..., 0] * half_diagonal
    padded = np.pad(nodes, ((0, 1), (0, 1)), mode="edge").ravel()
    padded.flags.writeable = False
    return padded


def on_plane(relief: ReliefDisplacement | None, camera: Camera, pixels: PointsNx2) -> PointsNx2:
    """Where the camera would have seen the content of pixels (n, 2) if the ground were a plane."""
    return pixels if relief is None else pixels + relief.at(camera, pixels)


def as_seen(
    relief: ReliefDisplacement | None,
    camera: Camera,
    pixels: PointsNx2,
    guess: PointsNx2 | None = None,
    converged_px: float = CONVERGED_PX,
) -> PointsNx2:
    """Inverse of `on_plane`; NaN stays NaN. `guess` (n, 2): initial value, if known. A point is done once its last step was
    shorter than `converged_px`; the next would be at most a quarter of that."""
    if relief is None:
        return pixels
    before = pixels if guess is None else guess
    found = pixels - relief.at(camera, before)
    going = np.flatnonzero(_far(found, before, converged_px))
    for _ in range(STEPS - 1):
        before = found[going]
        found[going] = pixels[going] - relief.at(camera, before)
        going = going[_far(found[going], before, converged_px)]
        if not going.size:
            break
    return found


def _far(points: PointsNx2, others: PointsNx2, px: float) -> Mask:
    apart = np.abs(points - others) > px
    return np.asarray(apart[:, 0] | apart[:, 1])
