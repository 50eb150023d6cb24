"""Things that stand up are shown by one frame each, not assembled of two.

Where two frames differ much, something is seen at another place, or at one only: a thing at its foot's place and where its height
shifts it to, in either frame. All such cells that touch make one thing, with what they enclose; it goes to the frame that sees it
better all in all, if one may show nearly all of it. What is nearly as large as a tile, as woods are, or as small as a person
who walks, stays as the seam's path has it.

A cell's owner depends on cells within `LARGEST` + `ROUND` of it, so it is independent of how much of the map is processed.
"""

from __future__ import annotations

import cv2
import numpy as np

from gcs_mosaic.render.cells import CELLS, NOBODY, OPEN, WHOLLY, Cells
from gcs_mosaic.render.sampling import UNDER_OVERLAY
from gcs_mosaic.stitch.arrays import Lattice, Mask

OTHER = 12.0  # grey levels; twice the usual difference of two images of the same ground (`seam_path.USUAL`)
CLOSED = 2  # cells: what is alike between two sides of a thing (a roof) is part of it
RIM = 1  # cells around it: the look is coarse, and an edge reaches into the next cell
NEARLY = 0.8  # share of a thing that its frame may show; what is left is as it was
ALONE = 8.0  # log ratio that no quality of view reaches, only a thing that the other frame has nowhere
ROUND = 2 * CLOSED + RIM
LARGEST = 25  # cells a side, rim included
SMALLEST = 11  # cells of the longer side: what is smaller the seam's path goes around, and it may be someone who walks
assert LARGEST + ROUND < CELLS, "a tile's owners follow from the tiles around it"


def as_wholes(cells: Cells, apart: Lattice, taken: Mask) -> Mask:
    """Which cells (h, w) show their second, with each thing whole; `apart`: how far the looks of first and second differ there.

    Ties, and things that no frame may show alone, stay as they are `taken`.
    """
    count, numbers, boxes, _ = cv2.connectedComponentsWithStats(_of_things(cells, apart), connectivity=8)
    longer = np.maximum(boxes[:, cv2.CC_STAT_WIDTH], boxes[:, cv2.CC_STAT_HEIGHT])
    found = taken.copy()
    may_yield = (cells.lead < OPEN) & (cells.inside[1] == WHOLLY)
    for number in range(1, count):
        if not SMALLEST <= longer[number] <= LARGEST:
            continue
        left, top, width, height, _ = boxes[number].tolist()
        box = slice(top, top + height), slice(left, left + width)
        at = numbers[box] == number
        lead, whole = cells.lead[box][at].astype(np.float64), cells.inside[1][box][at] == WHOLLY
        if (whole & (lead >= ALONE) & (lead < UNDER_OVERLAY / 2)).any():
            continue  # someone who walks: a frame has something here that no other has anywhere
        winner = _winner(cells.first[box][at], cells.second[box][at], np.minimum(lead, ALONE), may_yield[box][at])
        if winner is not None:
            to_second = cells.first[box][at] != winner
            can = ~to_second | ((cells.second[box][at] == winner) & may_yield[box][at])
            found[box][at] = np.where(can, to_second, taken[box][at])
    return found


def _of_things(cells: Cells, apart: Lattice) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    """(h, w) uint8: 1 for cells of things, where there are two frames."""
    two = (cells.second != NOBODY) & (cells.inside[1] > 0)
    mask = ((apart > OTHER) & two).astype(np.uint8)
    side = 2 * CLOSED + 1
    closed = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, np.ones((side, side), np.uint8), borderValue=0)
    wider = cv2.dilate(closed, np.ones((2 * RIM + 1, 2 * RIM + 1), np.uint8))
    return np.asarray(wider * two, np.uint8)


def _winner(first: np.ndarray, second: np.ndarray, lead: np.ndarray, may_yield: np.ndarray) -> int | None:
    """Of a thing's cells (n,): the frame that may show (nearly) all of it and sees it best; None if none may, or two as well."""
    worth = []
    for one in np.unique(first).tolist():
        leads, follows = first == one, (second == one) & may_yield
        if (leads | follows).mean() >= NEARLY:
            worth.append((float(lead[leads].sum() - lead[follows].sum() - OPEN * (~(leads | follows)).sum()), one))
    worth.sort()
    if not worth or (len(worth) > 1 and worth[-1][0] == worth[-2][0]):
        return None
    return int(worth[-1][1])
