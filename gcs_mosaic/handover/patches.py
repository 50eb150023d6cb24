"""Patches of ground that are to be flown again, as cells of an island's grid: gaps; what was seen too seldom or too coarsely."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.errors import UsageError
from gcs_mosaic.stitch.arrays import Mask, PointsNx2
from gcs_mosaic.views.coverage import Coverage, Gap, Grid, flown_area

LEAST_PATCH = 1 / 64  # of a footprint's area: smaller ones are the zigzag of where frames end
CELLS, CELLS_OF_FOOTPRINT = 200, 16  # at most, along an outline's longer side
NO_GROUND = "The outline holds no ground: give three corners or more of an area."
LEAST_SHARE = 1e-4  # of its longer side's square: what is thinner is a line
EDGE = 0.5  # of a footprint: so near to the edge of the flown area ground is seen by fewer frames by nature


@dataclass(frozen=True, slots=True)
class Patch:
    """Cells of a grid, `mask` (rows, columns)."""

    grid: Grid
    mask: Mask

    @property
    def area(self) -> float:
        """Canvas units squared."""
        return float(self.mask.sum()) * self.grid.cell**2

    def widened(self, by: float) -> PointsNx2:
        """The middles (n, 2) of its cells on the canvas, and of all within `by` canvas units."""
        reach = int(np.ceil(by / self.grid.cell))
        mask = np.pad(self.mask.astype(np.uint8), reach)
        rows, columns = np.nonzero(cv2.dilate(mask, _disc(reach)))
        corner = np.array([self.grid.left, self.grid.top])
        return np.asarray((np.stack([columns, rows], axis=-1) - reach + 0.5) * self.grid.cell + corner, np.float64)


def patches_of_gaps(grid: Grid, gaps: list[Gap]) -> list[Patch]:
    """The cells of gaps, in their order."""
    found = []
    for gap in gaps:
        cells = (np.array(gap.outline) - [grid.left, grid.top]) / grid.cell - 0.5
        mask = np.zeros((grid.rows, grid.columns), np.uint8)
        cv2.fillPoly(mask, [np.rint(cells).astype(np.int32)], 1)
        found.append(Patch(grid, mask > 0))
    return found


def patch_of(outline: PointsNx2, footprint: float) -> Patch:
    """The ground inside an outline (n, 2) on the canvas; `footprint`: canvas units. Raises UsageError if that is nothing."""
    low, high = outline.min(axis=0), outline.max(axis=0)
    extent = float((high - low).max())
    if not cv2.contourArea((outline - low).astype(np.float32)) > LEAST_SHARE * extent**2:
        raise UsageError(NO_GROUND)
    cell = max(extent / CELLS, footprint / CELLS_OF_FOOTPRINT)
    columns, rows = (np.ceil((high - low) / cell).astype(int) + 1).tolist()
    grid = Grid(float(low[0]), float(low[1]), cell, columns, rows)
    mask = np.zeros((rows, columns), np.uint8)
    cv2.fillPoly(mask, [np.rint((outline - low) / cell - 0.5).astype(np.int32)], 1)
    return Patch(grid, mask > 0)


def patches_below(coverage: Coverage, footprint: float, looks: int, coarsest: float) -> list[Patch]:
    """Ground inside the flown area that fewer than `looks` frames saw, or none as finely as `coarsest` (canvas units a pixel):
    the largest first. `footprint`: canvas units."""
    grid = coverage.grid
    whole = flown_area(coverage, footprint)
    inner = cv2.erode(np.pad(whole, 1).astype(np.uint8), _disc(max(1, round(EDGE * footprint / grid.cell))))[1:-1, 1:-1]
    below = (whole & ~(coverage.finest <= coarsest)) | ((inner > 0) & (coverage.looks < looks))
    return patches_in(grid, below, footprint)


def patches_in(grid: Grid, below: Mask, footprint: float) -> list[Patch]:
    """Connected cells of a mask (rows, columns), the largest first; `footprint`: canvas units."""
    count, labels, facts, _ = cv2.connectedComponentsWithStats(below.astype(np.uint8), connectivity=4)
    least = LEAST_PATCH * (footprint / grid.cell) ** 2
    found = [Patch(grid, labels == k) for k in range(1, count) if facts[k, cv2.CC_STAT_AREA] >= least]
    return sorted(found, key=lambda patch: -patch.area)


def _disc(reach: int) -> NDArray[np.uint8]:
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1)), np.uint8)
