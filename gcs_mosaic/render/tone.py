"""What is left of different light is brought together along seams: the frames beside one take on a common tone.

The common tone at a place is the mean of those of the frames that show around it, by how much of the ground around each shows
and, at a frame's border, by how sure it is there. So it is one smooth field all over the map: it knows of no tiles, and
on either side of a seam it is the same.
"""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import find_objects

from gcs_mosaic.render.cells import CELLS, Numbers, Window
from gcs_mosaic.render.looks import Sight
from gcs_mosaic.render.placed import PlacedFrame
from gcs_mosaic.render.sampling import at_middles, lattice_part, places_in, sampled
from gcs_mosaic.render.warp_grid import Lattice

Shifts = NDArray[np.int8]

# Tones are told on squares of two by two cells, of which a tile has so many along its side.
SQUARES = CELLS // 2
BOX = 5  # squares a side over which, twice, it is told how much a frame shows around
REACH = 2 * BOX  # cells from which something shown counts, at most
SURE = 0.05  # weight from which on a frame's tone counts fully
MOST_SHIFT = 12.0  # grey levels that a tone is shifted at most; more is no light but a thing that has moved
FINE = 8  # steps of a shift in a grey level, finer than anybody sees


def wide(shown: NDArray[np.bool_]) -> Lattice:
    """How much of the ground around each square (h / 2, w / 2) is shown, of cells (h, w), in whole numbers: so it is the same
    wherever the picture begins."""
    rows = shown[::2].astype(np.float32) + shown[1::2]
    box = rows[:, ::2] + rows[:, 1::2]
    for _ in range(2):
        box = cv2.boxFilter(box, cv2.CV_32F, (BOX, BOX), normalize=False, borderType=cv2.BORDER_CONSTANT)  # type: ignore
    return np.asarray(box, np.float32)


def tone(frame: PlacedFrame, sight: Sight, window: Window) -> tuple[Lattice, Lattice]:
    """A frame's tone at the squares of a window: (4, h, w) blue, green, red and how far things colour it; and how sure it is."""
    assert sight.tone is not None
    where = lattice_part(frame.lattice, window)
    places = places_in(at_middles(frame.lattice.pixels[where]), frame.lattice, sight.tone.shape)
    values = np.stack(cv2.split(sampled(sight.tone.astype(np.float32), places))).astype(np.float32)
    for one, factor in zip(values, frame.factors(window, at_middles), strict=False):
        one *= factor
    sure = np.clip(at_middles(frame.lattice.weight[where]) / np.float32(SURE), 0, 1)
    return values, sure.astype(np.float32)


Seer = Callable[[int], tuple[PlacedFrame, Sight] | None]


def shifts(first: Numbers, window: Window, seer: Seer) -> dict[int, tuple[Window, Shifts]]:
    """What the tones of the frames that show on a window's cells (h, w) are to be shifted by, in `FINE` steps of a grey level:
    (3, rows, columns) of the squares of a part of the window, by the frame's number. Not right within `REACH` of the rim, unless
    that is where all ends.

    `seer` gives a frame and its sight by its number, None if it is here no more.
    """
    size = window.shape[0] // 2, window.shape[1] // 2
    total, weight = np.zeros((4, *size), np.float32), np.zeros(size, np.float32)
    tones: dict[int, tuple[Window, Lattice]] = {}
    for number, box in shown_boxes(first, window).items():
        if (known := seer(number)) is None:
            continue
        frame, sight = known
        there = box.wider().common(frame.window)
        there = None if there is None else there.common(window)
        if there is None:
            continue
        values, sure = tone(frame, sight, there)
        share = wide(first[window.of(there)] == number) * sure
        place = squares(window.of(there))
        total[:, place[0], place[1]] += values * share
        weight[place] += share
        tones[number] = there, values
    np.divide(total, weight, out=total, where=weight > 0)
    return {
        number: (there, _shift(total, weight, squares(window.of(there)), values))
        for number, (there, values) in tones.items()
    }


def squares(cells: tuple[slice, slice]) -> tuple[slice, slice]:
    """The rows and columns of squares of those of cells."""
    rows, columns = (slice(one.start // 2, one.stop // 2) for one in cells)
    return rows, columns


def shown_boxes(first: Numbers, window: Window) -> dict[int, Window]:
    """By the numbers of the frames that show on these cells: the tiles that hold those of each."""
    found = {}
    for number, box in enumerate(find_objects(first + 1)):
        if box is not None:
            (top, bottom), (left, right) = ((one.start // CELLS, (one.stop - 1) // CELLS) for one in box)
            y, x = window.top, window.left
            found[number] = window._replace(top=y + top, left=x + left, bottom=y + bottom, right=x + right)
    return found


def _shift(common: Lattice, weight: Lattice, place: tuple[slice, slice], values: Lattice) -> Shifts:
    """From a frame's tone to the common one, as far as it is light that sets them apart: the same thing may stand out twice as
    much in one frame as in the other, not four times as much."""
    rows, columns = place
    apart = common[:, rows, columns] - values
    light = np.clip(2 - 2 * np.abs(apart[3]), 0, 1) * (weight[place] > 0)
    return np.asarray(np.rint(np.clip(apart[:3] * light, -MOST_SHIFT, MOST_SHIFT) * FINE), np.int8)
