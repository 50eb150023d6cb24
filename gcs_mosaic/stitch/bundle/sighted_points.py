"""The ground points over which an island is adjusted: of all tracks those that tie every pair of frames together evenly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gcs_mosaic.stitch.arrays import Array, IndexPairsNx2, Indices, PointsNx2, Vector

CELLS = 5  # a side, of the ground that two frames have in common: in each, one point
MOST_SIGHTINGS = 12  # of a point: what it costs grows with their square, and an evenly chosen dozen tells as much


@dataclass(frozen=True, slots=True)
class SightedPoints:
    """t points, each seen by two frames or more: m sightings, sorted by point."""

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

    def sums(self, values: Array) -> Array:
        """Sums (t, ...) over the sightings of each point, of values (m, ...)."""
        return np.asarray(np.add.reduceat(values, self.first, axis=0))

    def pairs(self) -> IndexPairsNx2:
        """(p, 2) frames that see a point in common, each pair once, the lower first."""
        one, other = together(self.point)
        one, other = self.row[one], self.row[other]
        frames = int(self.row.max(initial=0)) + 1
        return np.stack(np.divmod(np.unique((one * frames + other)[one < other]), frames), axis=1)


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
    row, pixels, point = row[order], pixels[order], point[order]
    kept = _evenly(point)
    row, pixels, point = row[kept], pixels[kept], point[kept]
    one, other = together(point)
    ahead = row[one] < row[other]
    one, other = one[ahead], other[ahead]
    cell = _cells(row[one] * (row.max(initial=0) + 1) + row[other], pixels[one])
    often = np.bincount(point)[point[one]]
    order = np.lexsort((point[one], -often, cell))
    best = order[np.concatenate([[True], np.diff(cell[order]) != 0])] if len(order) else order
    kept = np.flatnonzero(np.isin(point, point[one[best]]))
    _, number = np.unique(point[kept], return_inverse=True)
    return SightedPoints(row[kept], pixels[kept], number)


def _evenly(point: Indices) -> Indices:
    """Of sorted sightings at most MOST_SIGHTINGS of each point, evenly."""
    count = np.bincount(point)[point]
    place = np.arange(len(point)) - np.searchsorted(point, point)
    share = np.minimum(MOST_SIGHTINGS / count, 1.0)
    return np.flatnonzero(np.floor((place + 1) * share + 1e-9) > np.floor(place * share + 1e-9))


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
