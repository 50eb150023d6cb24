"""The ground points over which an island is adjusted: of all tracks those that tie every pair of frames together evenly."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from gcs_mosaic.stitch.arrays import Array, IndexPairsNx2, Indices, Mask, PointsNx2, Vector

CELLS = 5  # a side, of the ground that two frames have in common: in each, one point
ROWS_AT_ONCE = 64  # frames whose pairs are looked through at a time: those of all would fill memory on a long flight
MOST_SIGHTINGS = 12  # of a point: what it costs grows with their square, and an evenly chosen dozen tells as much


@dataclass(frozen=True, slots=True)
class SightedPoints:
    """t points, each seen by two frames or more: m sightings, sorted by point, and those of a point by frame."""

    row: Indices  # (m,) the frame
    pixels: PointsNx2  # (m, 2) as in `Problem`
    point: Indices  # (m,) 0 to t - 1

    @property
    def count(self) -> int:
        return int(self.point[-1]) + 1 if len(self.point) else 0

    @property
    def first(self) -> Indices:
        """(t,) where the sightings of each point begin."""
        return np.searchsorted(self.point, np.arange(self.count))

    def kept(self, which: Mask) -> SightedPoints:
        """Some of the sightings (m,), their points numbered anew."""
        return SightedPoints(self.row[which], self.pixels[which], np.unique(self.point[which], return_inverse=True)[1])

    def sums(self, values: Array) -> Array:
        """Sums (t, ...) over the sightings of each point, of values (m, ...)."""
        return np.asarray(np.add.reduceat(values, self.first, axis=0))

    def meetings(self) -> Iterator[tuple[Indices, Indices]]:
        """All pairs of sightings of one point, the lower frame's first, those of some frames at a time."""
        for start in range(0, int(self.row.max(initial=-1)) + 1, ROWS_AT_ONCE):
            first = np.flatnonzero((start <= self.row) & (self.row < start + ROWS_AT_ONCE))
            after = np.searchsorted(self.point, self.point[first], side="right") - 1 - first
            one = first.repeat(after)
            yield one, one + 1 + np.arange(len(one)) - (np.cumsum(after) - after).repeat(after)

    def pairs(self) -> IndexPairsNx2:
        """(p, 2) frames that see a point in common, each pair once, the lower first."""
        frames = int(self.row.max(initial=0)) + 1
        keys = [np.unique(self.row[one] * frames + self.row[other]) for one, other in self.meetings()]
        return np.stack(np.divmod(np.concatenate([np.empty(0, np.intp), *keys]), frames), axis=1)


def together(group: Indices) -> tuple[Indices, Indices]:
    """All ordered pairs of entries of the same group, an entry and itself too; `group` (k,) is sorted."""
    first = np.flatnonzero(np.concatenate([[True], np.diff(group) != 0])) if len(group) else np.empty(0, np.intp)
    sizes = np.diff(np.append(first, len(group)))
    each = np.repeat(sizes, sizes)
    one = np.repeat(np.arange(len(group)), each)
    return one, np.arange(len(one)) - np.repeat(np.cumsum(each) - each, each) + np.repeat(np.repeat(first, sizes), each)


def well_spread(row: Indices, pixels: PointsNx2, point: Indices) -> SightedPoints:
    """Of all sightings (m,) those of the points that are seen most often among those of one cell of a pair of frames."""
    order = np.lexsort((row, point))
    seen = SightedPoints(row[order], pixels[order], point[order])
    seen = seen.kept(_evenly(seen.point))
    best = [_best_in_cells(seen, *some) for some in seen.meetings()]
    return seen.kept(np.isin(seen.point, np.concatenate([np.empty(0, np.intp), *best])))


def _best_in_cells(seen: SightedPoints, one: Indices, other: Indices) -> Indices:
    """Of these pairs of sightings (k,) the points that are seen most often in each cell of each pair of frames."""
    pair, point = seen.row[one] * (int(seen.row.max(initial=0)) + 1) + seen.row[other], seen.point[one]
    cell = _cells(pair, seen.pixels[one])
    order = np.lexsort((point, -np.bincount(seen.point)[point], cell))
    first = np.concatenate([[True], np.diff(cell[order]) != 0])[: len(order)]
    return np.unique(point[order[first]])


def _evenly(point: Indices) -> Mask:
    """Of sorted sightings (m,) at most MOST_SIGHTINGS of each point, evenly."""
    count = np.bincount(point)[point]
    place = np.arange(len(point)) - np.searchsorted(point, point)
    share = np.minimum(MOST_SIGHTINGS / count, 1.0)
    return np.asarray(np.floor((place + 1) * share + 1e-9) > np.floor(place * share + 1e-9))


def _cells(pair: Indices, pixels: PointsNx2) -> Indices:
    """A number for each cell of each pair's common ground, (k,), which reaches as far as its points (k, 2) in the first frame."""
    _, which = np.unique(pair, return_inverse=True)
    low, high = (_extreme(best, which, pixels) for best in (np.minimum, np.maximum))
    at = (CELLS * (pixels - low[which]) / np.maximum(high - low, 1e-9)[which]).astype(np.intp)
    across, down = np.minimum(at, CELLS - 1).T
    return np.asarray((which * CELLS + down) * CELLS + across)


def _extreme(best: np.ufunc, which: Indices, values: PointsNx2) -> PointsNx2:
    """The least or greatest values (k, 2) of each group, (g, 2)."""
    order = np.argsort(which, kind="stable")
    first = np.searchsorted(which[order], np.arange(int(which.max(initial=-1)) + 1))
    return np.asarray(best.reduceat(values[order], first, axis=0)) if len(first) else np.empty((0, 2))


def patch_shares(places: PointsNx2, size: float) -> Vector:
    """What part of its patch of ground, a square of this size, each of these places (t, 2) is: (t,)."""
    _, patch, count = np.unique(np.floor(places / size), axis=0, return_inverse=True, return_counts=True)
    return np.asarray(1.0 / count[patch.ravel()])
