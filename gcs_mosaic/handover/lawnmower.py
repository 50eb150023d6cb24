"""Parallel lines over a patch of ground, there and back (a lawnmower, or boustrophedon: Choset, Annals of Mathematics and
Artificial Intelligence 31, 2001), and the order in which patches are flown.

Places are metres east and north on one plane, (n, 2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from gcs_mosaic.geo.ellipsoid import Spots
from gcs_mosaic.stitch.arrays import Array


@dataclass(frozen=True, slots=True)
class Sweep:
    """Lines (k, 2, 2) in the order and direction in which they are flown: from, to."""

    lines: Array

    def variants(self) -> list[Sweep]:
        """The four ways to fly it: from either side, each line from either end."""
        back = self.lines[:, ::-1]
        return [Sweep(one) for one in (self.lines, self.lines[::-1], back, back[::-1])]


def sweep_over(cells: Spots, size: float, spacing: float, beyond: float) -> Sweep:
    """Lines over the cells (n, 2) of a patch, `size` wide, along its longer side: at most `spacing` apart, each `beyond` longer
    at both ends. Of a patch that is bent, or has a hole, only what it covers is flown over."""
    along, across = _axes(cells)
    s, t = cells @ along, cells @ across
    least, width = t.min() - size / 2, np.ptp(t) + size
    count = int(np.ceil(width / spacing - 1e-9))
    lines: list[Array] = []
    for k in range(count):
        middle = least + (k + 0.5) * width / count
        inside = np.sort(s[np.abs(t - middle) <= (width / count + size) / 2])
        pieces = [
            np.stack([(first - beyond) * along, (last + beyond) * along]) + middle * across
            for first, last in _stretches(inside, spacing + size)
        ]
        lines += [piece[::-1] for piece in pieces[::-1]] if k % 2 else pieces
    return Sweep(np.stack(lines))


def in_order(sweeps: Sequence[Sweep], start: Spots) -> list[tuple[int, Sweep]]:
    """Each with its index: always the one whose beginning is nearest to where the last one ended, flown from that end."""
    left, at = dict(enumerate(sweeps)), start
    found = []
    while left:
        ways = [(index, one) for index, sweep in left.items() for one in sweep.variants()]
        away = np.hypot(*(np.array([one.lines[0, 0] for _, one in ways]) - at).T)
        index, nearest = ways[int(away.argmin())]
        found.append((index, nearest))
        at = nearest.lines[-1, 1]
        del left[index]
    return found


def _axes(points: Spots) -> tuple[Array, Array]:
    """Unit vectors along and across the smallest rectangle around points."""
    corners = cv2.boxPoints(cv2.minAreaRect((points - points.mean(axis=0)).astype(np.float32))).astype(np.float64)
    sides = corners[1] - corners[0], corners[2] - corners[1]
    longer = max(sides, key=lambda side: float(np.hypot(*side)))
    length = float(np.hypot(*longer))
    along = longer / length if length > 0 else np.array([1.0, 0.0])
    return along, np.array([-along[1], along[0]])


def _stretches(in_a_row: Array, most: float) -> list[tuple[float, float]]:
    """First and last of each run of sorted numbers that are no farther apart than `most`; none of none."""
    if not len(in_a_row):
        return []
    cuts = np.flatnonzero(np.diff(in_a_row) > most)
    firsts, lasts = [0, *(cuts + 1).tolist()], [*cuts.tolist(), len(in_a_row) - 1]
    return [(float(in_a_row[first]), float(in_a_row[last])) for first, last in zip(firsts, lasts, strict=True)]
