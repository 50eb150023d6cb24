"""Pictures laid on windows of the ground: projected exactly at each `STEP`th cell, and bilinearly between, as on tiles."""

from __future__ import annotations

import cv2
import numpy as np

from gcs_mosaic.render.warp_grid import LATTICE_STEP
from gcs_mosaic.stitch.arrays import AnyImage, Array, Lattice

STEP = LATTICE_STEP  # cells; see there for the error, of 0.1 px at most
NOWHERE = -1e4  # px; outside of every picture


def between_steps(exact: Array, rows: int, columns: int) -> Lattice:
    """Pixels (rows, columns, 2) at the middles of a window's cells, from those at the corners of blocks of `STEP` cells (down,
    across, 2), which begin at its corner and reach beyond its far edges."""
    down, across = exact.shape[:2]
    size = (
        across * STEP,
        down * STEP,
    )  # resizing puts a value at the middle of its block, so half a block is beyond the rim
    wide = cv2.resize(exact.astype(np.float32), size, interpolation=cv2.INTER_LINEAR)
    half = STEP // 2
    return np.ascontiguousarray(wide[half : half + rows, half : half + columns], np.float32)


def sampled(image: AnyImage, at: Lattice) -> AnyImage:
    """An image (h, w, bands) at pixels (rows, columns, 2): (rows, columns, bands), the nearest edge for what lies outside. Pixels
    that are NaN become `NOWHERE`."""
    cv2.patchNaNs(at, NOWHERE)
    found = cv2.remap(image, at, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)  # type: ignore[call-overload]
    return np.asarray(found).reshape(*at.shape[:2], image.shape[2])
