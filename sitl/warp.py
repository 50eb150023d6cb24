"""Maps a frame's pixels to its canvas as given in a placements.json."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Placed:
    """A frame as placed: a homography, and optionally a warp (lens and relief).

    The warp is a grid of canvas positions; between them the homography applies plus the bilinearly interpolated residual.
    """

    name: str
    island: int
    canvas_from_frame: Floats
    columns: Floats  # (c,) px
    rows: Floats  # (r,) px
    residual: Floats  # (r, c, 2) canvas units, empty without a warp

    def canvas(self, pixels: Floats) -> Floats:
        """(n, 2) pixels -> (n, 2) canvas; NaN beyond the homography's horizon."""
        flat = project(self.canvas_from_frame, pixels)
        return flat + self.bent(pixels) if self.residual.size else flat

    def bent(self, pixels: Floats) -> Floats:
        (i, u), (j, v) = cell(self.columns, pixels[:, 0]), cell(self.rows, pixels[:, 1])
        upper = (1 - u) * self.residual[j, i] + u * self.residual[j, i + 1]
        lower = (1 - u) * self.residual[j + 1, i] + u * self.residual[j + 1, i + 1]
        return np.asarray((1 - v) * upper + v * lower)


def cell(edges: Floats, values: Floats) -> tuple[NDArray[np.intp], Floats]:
    """Cell index of each value, and its fraction (n, 1) within the cell."""
    index = np.clip(np.searchsorted(edges, values) - 1, 0, len(edges) - 2)
    return index, ((values - edges[index]) / (edges[index + 1] - edges[index]))[:, None]


def project(matrix: Floats, points: Floats) -> Floats:
    homogeneous = np.c_[points, np.ones(len(points))] @ matrix.T
    depth = np.where(homogeneous[:, 2] > 1e-12, homogeneous[:, 2], np.nan)
    return np.asarray(homogeneous[:, :2] / depth[:, None])


def placed_frame(entry: dict[str, Any], middle: Floats) -> Placed:
    """Parse one entry of "frames"; middle (2,) is the picture's centre, which fixes the homography's sign."""
    matrix = np.array(entry["canvas_from_frame"], np.float64).reshape(3, 3)
    if matrix[2] @ [*middle, 1.0] < 0:
        matrix = -matrix
    warp, none = entry.get("warp"), np.empty(0)
    if not warp:
        return Placed(entry["name"], int(entry["island"]), matrix, none, none, none)
    columns, rows, canvas = (np.array(warp[key], np.float64) for key in ("x", "y", "canvas"))
    x, y = np.meshgrid(columns, rows)
    flat = project(matrix, np.c_[x.ravel(), y.ravel()]).reshape(canvas.shape)
    return Placed(entry["name"], int(entry["island"]), matrix, columns, rows, np.nan_to_num(canvas - flat))
