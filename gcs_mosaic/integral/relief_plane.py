"""Relief about a window as a plane: over woods the map's relief follows crowns, and so would a focus that follows it.

Each frame's relief shifts its pixels by how high lies what they show. What of the shifts is constant or linear over the
surroundings of a window is of sloping ground, or of a lens that is not quite right, and is kept; the rest is of crowns, roofs and
the like, which are in focus or out of it by their own heights.
"""

from __future__ import annotations

import numpy as np

from gcs_mosaic.stitch.arrays import FloatImage, PointsNx2
from gcs_mosaic.stitch.camera.geometry import Camera
from gcs_mosaic.stitch.camera.relief import ReliefDisplacement

SURROUNDINGS = 1.0  # of the window's own side, on all sides of it
LEAST_NODES = 4  # along each side: a slope is not told by fewer
REACH = 0.2  # of a frame's longer side: one standard deviation of the weights about a place
TIE = 0.3  # pull of slopes to none, relative to one node at the rim of what is fitted


def plane_of(
    relief: ReliefDisplacement | None, camera: Camera, low: PointsNx2, high: PointsNx2
) -> ReliefDisplacement | None:
    """The shifts of a frame as a plane fitted between the pixels low and high (2,) of a window; None without relief."""
    if relief is None:
        return None
    columns, rows = (
        np.linspace(0, size - 1, nodes)
        for size, nodes in ((camera.width, relief.columns), (camera.height, relief.rows))
    )
    wide = SURROUNDINGS * (high - low)
    across, down = (_nodes(along, low[k] - wide[k], high[k] + wide[k]) for k, along in enumerate((columns, rows)))
    x, y = np.meshgrid(columns[across], rows[down])
    middle = np.array([x.mean(), y.mean()])
    reach = max(float(np.abs(x - middle[0]).max()), float(np.abs(y - middle[1]).max()), 1.0)
    terms = np.column_stack([np.ones(x.size), (x.ravel() - middle[0]) / reach, (y.ravel() - middle[1]) / reach])
    shifts = relief.grid[down][:, across].reshape(-1, 2).astype(np.float64)
    normal = terms.T @ terms + np.diag([0.0, TIE, TIE])
    found = np.linalg.solve(normal, terms.T @ shifts)
    corners = np.array(
        [[0.0, 0.0], [camera.width - 1.0, 0.0], [0.0, camera.height - 1.0], [camera.width - 1.0, camera.height - 1.0]]
    )
    at_corners = np.column_stack([np.ones(4), (corners - middle) / reach]) @ found
    grid: FloatImage = at_corners.reshape(2, 2, 2).astype(np.float32)
    return ReliefDisplacement(2, 2, grid.tobytes())


def slopes_of(relief: ReliefDisplacement | None, camera: Camera) -> ReliefDisplacement | None:
    """The shifts of a frame as a plane fitted about each place by itself, nearer nodes counting more (W. S. Cleveland, JASA
    74(368), 1979): the same wherever it is asked for, so that windows beside each other fit together. None without relief."""
    if relief is None:
        return None
    x, y = np.meshgrid(np.linspace(0, camera.width - 1, relief.columns), np.linspace(0, camera.height - 1, relief.rows))
    nodes = np.column_stack([x.ravel(), y.ravel()]) / (REACH * max(camera.width, camera.height))
    apart = nodes[None] - nodes[:, None]  # (n, n, 2), from each node to all
    weight = np.exp(-0.5 * (apart**2).sum(axis=2))
    terms = np.concatenate([np.ones((*weight.shape, 1)), apart], axis=2)
    weighted = terms.transpose(0, 2, 1) * weight[:, None]
    normal = weighted @ terms + np.diag([0.0, TIE, TIE])
    found = np.linalg.solve(normal, weighted @ relief.grid.reshape(-1, 2).astype(np.float64))
    return ReliefDisplacement(relief.columns, relief.rows, found[:, 0].astype(np.float32).tobytes())


def _nodes(along: np.ndarray, low: float, high: float) -> np.ndarray:
    """Indices of those between two pixels, and of the nearest ones if they are few."""
    inside = np.flatnonzero((along >= low) & (along <= high))
    if len(inside) >= LEAST_NODES:
        return inside
    nearest = np.argsort(np.abs(along - (low + high) / 2), kind="stable")[: min(LEAST_NODES, len(along))]
    return np.sort(nearest)
