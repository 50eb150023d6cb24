"""Where a seam runs between two pictures of the same ground that are about as good: where they differ least.

A tall thing seen from two sides, or somebody who moves, must not be cut in two. What was decided at the lattice points is
held where one picture is clearly better and on the tile's rim, which the next tile shares; between, each point follows its
neighbours, and the more so the more the pictures differ on the way there. So points on one thing come to agree, and signs
change where nothing is seen to change. This is the random walker of L. Grady, "Random Walks for Image Segmentation", PAMI
28(11), 2006, with differences in the place of gradients.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.stitch.painting.lattice import Lattice

Image = NDArray[np.uint8]

OPEN = 1.4  # log ratio: where one picture is up to four times as good, the seam is free to run elsewhere
USUAL = 6.0  # grey levels that two pictures of the same ground differ by, from noise and what light and places leave
MOST = 400.0  # times as strong as on even ground two points hold together at most
STEPS = 48  # of relaxation; a tile is 33 points wide


def least_seen(decided: Lattice, one: Image, other: Image) -> Lattice:
    """What was decided at a tile's points (33, 33), above 0 for the one picture (256, 256, 3) and below for the other, with
    the change of sign moved to where they differ least."""
    free = np.abs(decided) < OPEN
    free[[0, -1]] = free[:, [0, -1]] = False
    if not free.any() or (decided > 0).all() or (decided <= 0).all():
        return decided
    down, right = _ties(one, other, len(decided) - 1)
    u = np.clip(decided, -OPEN, OPEN)
    total = down[:-1, 1:-1] + down[1:, 1:-1] + right[1:-1, :-1] + right[1:-1, 1:]
    inner, held = free[1:-1, 1:-1], u[1:-1, 1:-1].copy()
    for _ in range(STEPS):
        pull = down[:-1, 1:-1] * u[:-2, 1:-1] + down[1:, 1:-1] * u[2:, 1:-1]
        pull += right[1:-1, :-1] * u[1:-1, :-2] + right[1:-1, 1:] * u[1:-1, 2:]
        u[1:-1, 1:-1] = np.where(inner, pull / total, held)
    return np.asarray(np.where(free, u, decided), dtype=np.float32)


def _ties(one: Image, other: Image, cells: int) -> tuple[Lattice, Lattice]:
    """How strongly points hold together with those below, (n, n + 1), and those to the right, (n + 1, n), for n cells."""
    apart = np.max(cv2.split(cv2.absdiff(one, other)), axis=0)
    mean = cv2.resize(apart, (cells, cells), interpolation=cv2.INTER_AREA).astype(np.float32)
    strength = np.minimum(1 + (mean / USUAL) ** 4, MOST)
    wide = np.pad(strength, 1, mode="edge")  # a tie lies between two cells
    return (wide[1:-1, :-1] + wide[1:-1, 1:]) / 2, (wide[:-1, 1:-1] + wide[1:, 1:-1]) / 2
