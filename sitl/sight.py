"""What a view meets first among things that stand tall: crowns and roofs hide what is behind them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .geometry import LOWEST_VIEW, Array, CameraState, HeightAt, sinking_views

Mask = NDArray[np.bool_]

STEP = 0.6  # metres of height between two looks: at 35 degrees off the vertical one cell of the height map
HALVINGS = 4  # of the last step: down to 4 cm


def first_met(state: CameraState, rays: Array, height_at: HeightAt, tallest: float) -> tuple[Array, Array]:
    """(x, y) in metres of the surface seen along rays (..., 2), NaN for sky; nothing is higher than `tallest` or below 0."""
    east, south, down = sinking_views(state, rays)
    per_metre = np.divide(1, down, out=np.full_like(down, np.nan), where=down > LOWEST_VIEW)
    east, south = east * per_metre, south * per_metre

    def meets(height: Array) -> Mask:
        drop = state.height - height
        return np.asarray(height_at(state.x + east * drop, state.y + south * drop) >= height)

    above = np.full_like(east, tallest)
    open_still: Mask = np.ones(east.shape, np.bool_)
    for height in np.linspace(tallest, 0, max(2, round(tallest / STEP)), endpoint=False)[1:]:
        open_still &= np.logical_not(meets(np.full_like(east, height)))
        above[open_still] = height
    step = tallest / max(2, round(tallest / STEP))
    below = np.maximum(above - east.dtype.type(step), 0)
    for _ in range(HALVINGS):
        middle = (above + below) / 2
        met = meets(middle)
        above, below = np.where(met, above, middle), np.where(met, middle, below)
    drop = state.height - below
    return state.x + east * drop, state.y + south * drop
