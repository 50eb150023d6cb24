"""A detection map as polygons, for other programs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np

from gcs_mosaic.detection.detection_map import DetectionMap
from gcs_mosaic.stitch.arrays import Mask, PointsNx2

BOUNDS = (0.0, 0.25, 0.5, 0.75, 1.0)
ADVICE = "by a model; it clears no ground"


@dataclass(frozen=True, slots=True, kw_only=True)
class DetectionArea:
    """Connected ground of a probability from `least` to `most`. `leaves_unknown`: share of it; `rings`: the outer outline (n, 2)
    on the canvas, then holes."""

    least: float
    most: float
    mean: float
    leaves_unknown: float
    rings: tuple[PointsNx2, ...]


def areas(found: DetectionMap) -> Iterator[DetectionArea]:
    """Of the flown area; gaps are in the lowest."""
    known = found.flown & np.isfinite(found.probability)
    for least, most in pairwise(BOUNDS):
        cells = known & (found.probability >= least) & ((found.probability < most) | (most == BOUNDS[-1]))
        count, labels = cv2.connectedComponents(cells.astype(np.uint8), connectivity=4)
        for one in range(1, count):
            inside = labels == one
            rings = tuple(_rings(found, inside))
            mean, unknown = float(found.probability[inside].mean()), found.leaves_unknown_in(inside)
            yield DetectionArea(least=least, most=most, mean=mean, leaves_unknown=unknown, rings=rings)


def _rings(found: DetectionMap, cells: Mask) -> Iterator[PointsNx2]:
    """Along the borders of cells, which are doubled so that a single one has a border."""
    doubled = np.repeat(np.repeat(cells.astype(np.uint8), 2, axis=0), 2, axis=1)
    outlines, order = cv2.findContours(doubled, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_SIMPLE)
    ranked = sorted(zip(outlines, order[0], strict=True), key=lambda one: one[1][3] >= 0)
    for outline, _ in ranked:
        if len(outline) >= 3:
            corner = np.array([found.grid.left, found.grid.top])
            yield corner + (outline[:, 0].astype(np.float64) + 0.5) / 2 * found.grid.cell
