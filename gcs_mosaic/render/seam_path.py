"""Seam path between two frames of similar quality: where they differ least.

A tall thing seen from two sides, or a moving person, must not be cut in two. The decision is fixed where one frame is clearly
better; in between, each cell follows its neighbours, the more strongly the more the two frames differ there. So cells on one
thing come to agree, and seams run where no change is visible. This is the random walker of L. Grady, "Random Walks for Image
Segmentation", PAMI 28(11), 2006, with differences in place of gradients. Every cell has two frames of its own to choose from; a
neighbour supports whichever of them it may show itself.

The influence of cells has a limited range, so the path is independent of how much of the map is processed.
"""

from __future__ import annotations

import cv2
import numpy as np

from gcs_mosaic.render.cells import CELLS, NOBODY, OPEN, WHOLLY, Cells, Owned
from gcs_mosaic.render.whole_things import as_wholes
from gcs_mosaic.stitch.arrays import FrameNumbers, Indices, Lattice, Mask, Planes, Vector32

Steady = list[Vector32]
Pulls = list[tuple[Indices, Vector32, Vector32]]

USUAL = 6.0  # grey levels; usual difference of images of the same ground: noise, residual exposure and pose errors
MOST = 400.0  # maximum strength of the coupling of two cells, relative to uniform ground
BAND = 10  # maximum displacement of a seam, in cells
STEPS = 20  # of relaxation, each updating every second cell from its neighbours
assert BAND + STEPS < CELLS, "a tile's owners follow from the tiles around it"


def least_seen(cells: Cells, looks: tuple[Planes, Planes]) -> Owned:
    """The frames to show, with hard seams; `looks` (3, h, w) of the first and the second. Invalid within a tile of the rim,
    unless the map ends there."""
    free = (cells.lead < OPEN) & (cells.inside[1] == WHOLLY) & _beside_seams(cells.first)
    held = np.where(free, np.float32(0.5) + cells.lead / np.float32(2 * OPEN), np.float32(1))
    apart = _apart(looks)
    taken = free & (_relaxed(held, free, cells, apart) < 0.5)
    return hard(cells, as_wholes(cells, apart, taken))


def _beside_seams(first: FrameNumbers) -> Mask:
    """Which cells (h, w) are near a seam."""
    seams = np.zeros(first.shape, np.uint8)
    seams[1:] |= first[1:] != first[:-1]
    seams[:, 1:] |= first[:, 1:] != first[:, :-1]
    return np.asarray(cv2.dilate(seams, np.ones((2 * BAND + 1, 2 * BAND + 1), np.uint8)) > 0)


def hard(cells: Cells, taken: Mask) -> Owned:
    """The first everywhere, or the second where `taken`; the other one where that covers only a part."""
    first, second = np.where(taken, cells.second, cells.first), np.where(taken, cells.first, cells.second)
    cut = np.where(taken, cells.inside[1], cells.inside[0]) != WHOLLY
    return Owned(first, np.where(cut, second, np.int32(NOBODY)), np.full(first.shape, 255, np.uint8))


def _relaxed(held: Lattice, free: Mask, cells: Cells, apart: Lattice) -> Lattice:
    """Probability of each cell to show its first, starting from `held`. Only free cells are updated, contiguous in memory, as
    they are few. In checkerboard order: updated all at once, two strongly coupled cells would oscillate."""
    wide = np.pad(held, 1)
    p, strength = wide.ravel(), np.pad(_strength(apart), 1).ravel()
    first, second = (np.pad(one, 1, constant_values=NOBODY).ravel() for one in (cells.first, cells.second))
    row, column = np.nonzero(np.pad(free, 1))
    here = row * wide.shape[1] + column
    halves = [_pulls(here[(row + column) % 2 == colour], wide.shape[1], strength, first, second) for colour in (0, 1)]
    for step in range(STEPS):
        _relax(p, *halves[step % 2])
    return np.asarray(wide[1:-1, 1:-1])


def _pulls(
    here: Indices, width: int, strength: Vector32, first: FrameNumbers, second: FrameNumbers
) -> tuple[Indices, Steady, Pulls]:
    """Couplings of these cells to their first and second: constant parts, and coefficients of the neighbours' probabilities."""
    mine, steady, pulls = (first[here], second[here]), [np.zeros(here.shape, np.float32) for _ in range(2)], []
    for step in (-width, width, -1, 1):
        there = here + step
        tie = (strength[there] + strength[here]) / 2
        by_first, by_second = ([tie * (other[there] == one) for one in mine] for other in (first, second))
        for total, one in zip(steady, by_second, strict=True):
            total += one
        pulls.append((there, by_first[0] - by_second[0], by_first[1] - by_second[1]))
    return here, steady, pulls


def _relax(p: Vector32, here: Indices, steady: Steady, pulls: Pulls) -> None:
    """Update these cells of `p` from their neighbours."""
    to_first, to_second = steady[0].copy(), steady[1].copy()
    for there, for_first, for_second in pulls:
        beside = p[there]
        to_first += beside * for_first
        to_second += beside * for_second
    total = to_first + to_second
    p[here] = np.where(total > 0, to_first / np.maximum(total, np.float32(1e-6)), p[here])


def _apart(looks: tuple[Planes, Planes]) -> Lattice:
    """Greatest difference of the two looks in any colour, grey levels."""
    one, other = looks
    return np.asarray(np.max(np.maximum(one, other) - np.minimum(one, other), axis=0), np.float32)


def _strength(apart: Lattice) -> Lattice:
    """Coupling strength of the cells."""
    return np.asarray(np.minimum(1 + (apart / np.float32(USUAL)) ** 4, np.float32(MOST)), np.float32)
