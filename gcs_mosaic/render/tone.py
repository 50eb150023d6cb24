"""Tone equalisation: residual exposure differences are removed along seams by a common tone of the frames on either side.

The common tone at a place is the mean over the frames shown around it, weighted by the ground that each shows nearby and, at a
frame's border, by confidence. So it is one smooth field over the whole map, independent of tiles, and equal on both sides of a
seam.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np

from gcs_mosaic.render.blend_maps import BlendMaps
from gcs_mosaic.render.cells import CELLS, Window
from gcs_mosaic.render.frame_warp import FrameWarp
from gcs_mosaic.render.render_list import Turn
from gcs_mosaic.render.sampling import at_middles, lattice_part, places_in, sampled
from gcs_mosaic.render.spread import ahead
from gcs_mosaic.stitch.arrays import FrameNumbers, Lattice, Mask, ToneShifts

# Tones are computed on squares of two by two cells; number along a tile's side.
SQUARES = CELLS // 2
BOX = 5  # squares a side of the box filter, applied twice, that measures how much a frame shows around
REACH = 2 * BOX  # maximum distance in cells at which a frame counts
SURE = 0.05  # weight from which a frame's tone counts fully
MOST_SHIFT = 12.0  # grey levels; maximum shift, as larger differences are things that have moved
FINE = 8  # steps of a shift per grey level, finer than visible


def wide(shown: Mask) -> Lattice:
    """Weight of the ground shown around each square (h / 2, w / 2), from cells (h, w), in integers: so it is independent of where
    the window begins."""
    rows = shown[::2].astype(np.float32) + shown[1::2]
    box = rows[:, ::2] + rows[:, 1::2]
    for _ in range(2):
        box = cv2.boxFilter(box, cv2.CV_32F, (BOX, BOX), normalize=False, borderType=cv2.BORDER_CONSTANT)  # type: ignore
    return np.asarray(box, np.float32)


def tone(frame: FrameWarp, maps: BlendMaps, window: Window) -> tuple[Lattice, Lattice]:
    """A frame's tone at the squares of a window: (4, h, w) blue, green, red and the influence of things; and its confidence."""
    assert maps.tone is not None
    where = lattice_part(frame.lattice, window)
    places = places_in(at_middles(frame.lattice.pixels[where]), frame.lattice, maps.tone.shape)
    values = np.stack(cv2.split(sampled(maps.tone.astype(np.float32), places))).astype(np.float32)
    for one, factor in zip(values, frame.factors(window, at_middles), strict=False):
        one *= factor
    sure = np.clip(at_middles(frame.lattice.weight[where]) / np.float32(SURE), 0, 1)
    return values, sure.astype(np.float32)


Seer = Callable[[int], tuple[FrameWarp, BlendMaps] | None]


def shifts(first: FrameNumbers, window: Window, seer: Seer, pool: Executor) -> dict[int, tuple[Window, ToneShifts]]:
    """Tone shifts of the frames that show on a window's cells (h, w), in 1 / `FINE` grey levels: (3, rows, columns) for the
    squares of a part of the window, by frame number. Invalid within `REACH` of the rim, unless the map ends there.

    `seer` returns a frame and its maps by number, None if it is no longer here.
    """
    size = window.shape[0] // 2, window.shape[1] // 2
    total, weight = np.zeros((4, *size), np.float32), np.zeros(size, np.float32)
    # A few frames at a time: looks and lattices of all together are 6 MB a frame.
    boxes = shown_boxes(first, window).items()
    works = filter(None, (_looking(first, window, number, box, seer) for number, box in boxes))
    # In capture order, not by number: what a sum of floats comes to depends on its order.
    seen = sorted(ahead(pool, works), key=lambda one: one.turn)
    for one in seen:
        place = squares(window.of(one.there))
        total[:, place[0], place[1]] += one.values * one.share
        weight[place] += one.share
    np.divide(total, weight, out=total, where=weight > 0)
    return {one.number: (one.there, _shift(total, weight, squares(window.of(one.there)), one.values)) for one in seen}


@dataclass(frozen=True, slots=True, eq=False)
class _Tones:
    """A frame's tones `there`, and how much ground it shows around each square (h, w)."""

    turn: Turn
    number: int
    there: Window
    values: Lattice
    share: Lattice


def _looking(first: FrameNumbers, window: Window, number: int, box: Window, seer: Seer) -> Callable[[], _Tones] | None:
    """A work that finds the tones of a frame that shows within a box; None if it is not there, or in a palette's colours."""
    known = seer(number)
    there = None if known is None else box.wider().common(known[0].window)
    there = None if there is None else there.common(window)
    if known is None or there is None or known[1].tone is None:
        return None
    return partial(_tones, *known, number, there, first[window.of(there)] == number)


def _tones(frame: FrameWarp, maps: BlendMaps, number: int, there: Window, shown: Mask) -> _Tones:
    values, sure = tone(frame, maps, there)
    return _Tones(frame.painted.turn, number, there, values, wide(shown) * sure)


def squares(cells: tuple[slice, slice]) -> tuple[slice, slice]:
    """Rows and columns of squares for those of cells."""
    rows, columns = (slice(one.start // 2, one.stop // 2) for one in cells)
    return rows, columns


def shown_boxes(first: FrameNumbers, window: Window) -> dict[int, Window]:
    """By number of the frames that show on these cells: the tiles containing each one's cells."""
    from scipy.ndimage import find_objects  # the page, which reads no more than tones, starts without

    found = {}
    for number, box in enumerate(find_objects(first + 1)):
        if box is not None:
            (top, bottom), (left, right) = ((one.start // CELLS, (one.stop - 1) // CELLS) for one in box)
            y, x = window.top, window.left
            found[number] = window._replace(top=y + top, left=x + left, bottom=y + bottom, right=x + right)
    return found


def _shift(common: Lattice, weight: Lattice, place: tuple[slice, slice], values: Lattice) -> ToneShifts:
    """Shift from a frame's tone to the common one, as far as exposure explains the difference: the same thing may have up to
    twice the contrast in one frame as in the other, not four times."""
    rows, columns = place
    apart = common[:, rows, columns] - values
    light = np.clip(2 - 2 * np.abs(apart[3]), 0, 1) * (weight[place] > 0)
    return np.asarray(np.rint(np.clip(apart[:3] * light, -MOST_SHIFT, MOST_SHIFT) * FINE), np.int8)
