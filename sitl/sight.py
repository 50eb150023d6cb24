"""Ray casting onto the height map with occlusion: crowns and roofs hide what is behind them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from .geometry import LOWEST_VIEW, Array, CameraState, HeightAt, sinking_views

StillPlace = Callable[[Array, Array, Array], tuple[Array, Array]]
Mask = NDArray[np.bool_]

STEP = 0.6  # metres of height per step: one cell of the height map at 35 degrees off nadir
HALVINGS = 4  # bisections of the last step: down to 4 cm


def first_met(
    state: CameraState,
    rays: Array,
    height_at: HeightAt,
    tallest: float,
    still: StillPlace = lambda x, y, height: (x, y),
) -> tuple[Array, Array, Array]:
    """(x, y, height) in metres of the first surface hit by rays (..., 2), NaN for sky; heights are within 0 to `tallest`.

    still: (x, y, height), all of one shape -> where in still air is what the wind has moved there; the result is in still air.
    """
    east, south, down = sinking_views(state, rays)
    per_metre = np.divide(1, down, out=np.full_like(down, np.nan), where=down > LOWEST_VIEW)
    east, south = east * per_metre, south * per_metre

    def place(height: Array) -> tuple[Array, Array]:
        drop = state.height - height
        return still(state.x + east * drop, state.y + south * drop, height)

    def meets(height: Array) -> Mask:
        return np.asarray(height_at(*place(height)) >= height)

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
    return *place(below), below
