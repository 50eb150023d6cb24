"""Where a seam runs between two frames that are about as good: where they differ least.

A tall thing seen from two sides, or somebody who moves, must not be cut in two. What was decided is held where one frame is
clearly better; between, each cell follows its neighbours, and the more so the more the two frames differ on the way there. So
cells on one thing come to agree, and seams run where nothing is seen to change. This is the random walker of L. Grady, "Random
Walks for Image Segmentation", PAMI 28(11), 2006, with differences in the place of gradients. Every cell has two frames of its
own to choose from; a neighbour speaks for whichever of them it may show itself.

A cell knows of others only so far away, so the course is the same however much of the map it is told for.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.render.cells import CELLS, NOBODY, OPEN, WHOLLY, Cells, Numbers, Owned
from gcs_mosaic.render.warp_grid import Lattice

Image = NDArray[np.uint8]
Places = NDArray[np.intp]
Steady = list[Lattice]
Pulls = list[tuple[Places, Lattice, Lattice]]

USUAL = 6.0  # grey levels that two pictures of the same ground differ by, from noise and what light and places leave
MOST = 400.0  # times as strong as on even ground two cells hold together at most
BAND = 10  # cells from where it would be that a seam is moved at most
STEPS = 20  # of relaxation, each of every second cell by those beside it
assert BAND + STEPS < CELLS, "a tile's owners follow from the tiles around it"


def least_seen(cells: Cells, looks: tuple[Image, Image]) -> Owned:
    """The frames that are to show, hard; `looks` (3, h, w) of the first and the second. Not right within a tile of the rim,
    unless that is where all ends."""
    free = (cells.lead < OPEN) & (cells.inside[1] == WHOLLY) & _beside_seams(cells.first)
    held = np.where(free, np.float32(0.5) + cells.lead / np.float32(2 * OPEN), np.float32(1))
    taken = free & (_relaxed(held, free, cells, looks) < 0.5)
    return hard(cells, taken)


def _beside_seams(first: Numbers) -> NDArray[np.bool_]:
    """Which cells (h, w) another frame shows nearby."""
    seams = np.zeros(first.shape, np.uint8)
    seams[1:] |= first[1:] != first[:-1]
    seams[:, 1:] |= first[:, 1:] != first[:, :-1]
    return np.asarray(cv2.dilate(seams, np.ones((2 * BAND + 1, 2 * BAND + 1), np.uint8)) > 0)


def hard(cells: Cells, taken: NDArray[np.bool_]) -> Owned:
    """The first everywhere, or the second where `taken`; the other one where that covers only a part."""
    first, second = np.where(taken, cells.second, cells.first), np.where(taken, cells.first, cells.second)
    cut = np.where(taken, cells.inside[1], cells.inside[0]) != WHOLLY
    return Owned(first, np.where(cut, second, np.int32(NOBODY)), np.full(first.shape, 255, np.uint8))


def _relaxed(held: Lattice, free: NDArray[np.bool_], cells: Cells, looks: tuple[Image, Image]) -> Lattice:
    """How likely each cell is to show its first, beginning with what is `held`. Only free cells are looked at, one after the
    other in memory: they are few. Each second one at a time, as on a chessboard: all at once, two that hold together strongly
    would change places for ever."""
    wide = np.pad(held, 1)
    p, strength = wide.ravel(), np.pad(_strength(looks), 1).ravel()
    first, second = (np.pad(one, 1, constant_values=NOBODY).ravel() for one in (cells.first, cells.second))
    row, column = np.nonzero(np.pad(free, 1))
    here = row * wide.shape[1] + column
    halves = [_pulls(here[(row + column) % 2 == colour], wide.shape[1], strength, first, second) for colour in (0, 1)]
    for step in range(STEPS):
        _relax(p, *halves[step % 2])
    return np.asarray(wide[1:-1, 1:-1])


def _pulls(
    here: Places, width: int, strength: Lattice, first: Numbers, second: Numbers
) -> tuple[Places, Steady, Pulls]:
    """What draws these cells to their first and second: the same whatever others show, and by how likely those show theirs."""
    mine, steady, pulls = (first[here], second[here]), [np.zeros(here.shape, np.float32) for _ in range(2)], []
    for step in (-width, width, -1, 1):
        there = here + step
        tie = (strength[there] + strength[here]) / 2
        by_first, by_second = ([tie * (other[there] == one) for one in mine] for other in (first, second))
        for total, one in zip(steady, by_second, strict=True):
            total += one
        pulls.append((there, by_first[0] - by_second[0], by_first[1] - by_second[1]))
    return here, steady, pulls


def _relax(p: Lattice, here: Places, steady: Steady, pulls: Pulls) -> None:
    """Bring these of all cells `p` in line with those around them."""
    to_first, to_second = steady[0].copy(), steady[1].copy()
    for there, for_first, for_second in pulls:
        beside = p[there]
        to_first += beside * for_first
        to_second += beside * for_second
    total = to_first + to_second
    p[here] = np.where(total > 0, to_first / np.maximum(total, np.float32(1e-6)), p[here])


def _strength(looks: tuple[Image, Image]) -> Lattice:
    """How strongly cells hold together with others."""
    one, other = looks
    apart = np.max(np.maximum(one, other) - np.minimum(one, other), axis=0).astype(np.float32)
    return np.asarray(np.minimum(1 + (apart / np.float32(USUAL)) ** 4, np.float32(MOST)), np.float32)
