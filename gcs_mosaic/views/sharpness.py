"""How sharp a frame is beside the others that saw the same ground.

What `stitch.features.sharpness` measures depends on the ground: a meadow has finer detail than a road. So a frame is compared
with the frames around it, which saw mostly the same; one that is blurred by motion stands out among them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.stitch.arrays import Array, Vector

SHARP = 0.75  # of the frames around are at most as sharp as what counts as sharp: some are blurred, few are sharper by chance
LEAST_AROUND = 3  # frames, the frame itself included, without which nothing can be told


def relative_sharpness(islands: Array, boxes: Array, sharpness: Sequence[float | None]) -> Vector:
    """For each frame (n,) its sharpness as a share of that of sharp frames around it, at most 1; NaN where nothing is known.

    `boxes` (n, 4) on the canvas; around are the frames whose middles lie in the same or a neighbouring square of the size of a
    usual frame.
    """
    measured = np.array([np.nan if one is None or one <= 0 else one for one in sharpness], np.float64)
    found = np.full(len(measured), np.nan)
    for island in np.unique(islands):
        members = np.flatnonzero((islands == island) & np.isfinite(measured) & np.isfinite(boxes).all(axis=1))
        if len(members) >= LEAST_AROUND:
            found[members] = _beside_others(boxes[members], measured[members])
    return found


def _beside_others(boxes: Array, measured: Vector) -> Vector:
    """Of one island's frames."""
    side = float(np.median((boxes[:, 2:] - boxes[:, :2]).max(axis=1)))
    squares = np.floor((boxes[:, :2] + boxes[:, 2:]) / (2 * side)).astype(np.int64)
    members: dict[tuple[int, int], list[int]] = {}
    for index, (x, y) in enumerate(squares.tolist()):
        members.setdefault((x, y), []).append(index)
    found = np.full(len(measured), np.nan)
    for (x, y), here in members.items():
        around = [index for dx in (-1, 0, 1) for dy in (-1, 0, 1) for index in members.get((x + dx, y + dy), ())]
        if len(around) >= LEAST_AROUND:
            sharp = float(np.quantile(measured[around], SHARP))
            found[here] = np.minimum(measured[here] / sharp, 1.0)
    return found


def sharpest(measured: Sequence[float | None]) -> NDArray[np.float64]:
    """Of looks at one place (n,): the sharpness of each as a share of the sharpest one's; 1 where it is not known."""
    known = np.array([np.nan if one is None or one <= 0 else one for one in measured], np.float64)
    if not np.isfinite(known).any():
        return np.ones(len(known))
    return np.where(np.isfinite(known), known / np.nanmax(known), 1.0)
