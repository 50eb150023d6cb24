"""Ground points seen by several frames: tracks of matches, and their heights.

With poses given, a point is the intersection of its rays, one small linear problem each. Most ground is flat, and two frames
taken close together say little about height: a prior keeps a point on the plane as far as its rays leave it open.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from gcs_mosaic.stitch.arrays import IndexPairsNx2, Indices, Mask, PointsNx2, Vector

ROUNDS = 5  # of reweighting


@dataclass(frozen=True, slots=True)
class Tracks:
    """Features of the same point, m in all: `nodes` (m,) as given, `track` (m,) the point's number."""

    nodes: Indices
    track: Indices


def tracks(matches: IndexPairsNx2, frame_of_node: Indices) -> Tracks:
    """Tracks from matched pairs (k, 2) of nodes 0 to n-1, whose frames are (n,).

    A connected component is one point; a track that contains a frame twice is inconsistent and dropped.
    """
    n = len(frame_of_node)
    links = sparse.coo_matrix((np.ones(len(matches), np.int8), (matches[:, 0], matches[:, 1])), shape=(n, n))
    _, label = connected_components(links, directed=False)
    order = np.lexsort((frame_of_node, label))
    twice = (np.diff(label[order]) == 0) & (np.diff(frame_of_node[order]) == 0)
    nodes = np.flatnonzero(~np.isin(label, label[order[1:][twice]]))
    _, track = np.unique(label[nodes], return_inverse=True)
    return Tracks(nodes, track)


@dataclass(frozen=True, slots=True)
class GroundPoints:
    """t points of the ground."""

    places: PointsNx2  # (t, 2) on the canvas
    heights: Vector  # (t,) above its plane, canvas units
    variances: Vector  # (t,) of the heights
    off2: Vector  # (t,) mean square of how far the rays of a point pass by it, in their deviations

    def some(self, which: Indices | Mask) -> GroundPoints:
        return GroundPoints(self.places[which], self.heights[which], self.variances[which], self.off2[which])


def ground_points(
    places: PointsNx2, by_height: PointsNx2, deviations: Vector, track: Indices, height_sigma: float
) -> GroundPoints:
    """Points (t) from one ray per observation.

    places (m, 2): intersections of the rays with the plane; by_height (m, 2): their shift per unit of height; deviations (m,):
    standard deviation of an observation, canvas units; height_sigma: of the points' heights about the plane. Robust (Cauchy): a
    wrong observation does not displace its point.
    """
    weight = 1 / deviations**2
    robust = np.ones(len(track))
    count = int(track.max(initial=-1)) + 1
    points, height = np.zeros((count, 2)), np.zeros(count)
    information, off2 = np.ones(count), np.zeros(len(track))
    for _ in range(ROUNDS):
        w = weight * robust
        total = np.bincount(track, w, count).astype(np.float64)
        mean_place, mean_slope = (_means(values, w, track, total) for values in (places, by_height))
        place, slope = places - mean_place[track], by_height - mean_slope[track]
        information = np.asarray(np.bincount(track, w * (slope**2).sum(axis=1), count) + height_sigma**-2)
        height = np.asarray(-np.bincount(track, w * (place * slope).sum(axis=1), count) / information)
        points = mean_place + height[:, None] * mean_slope
        off2 = ((places + height[track, None] * by_height - points[track]) ** 2).sum(axis=1) * weight
        robust = 1 / (1 + off2)
    return GroundPoints(
        points, height, 1 / information, np.bincount(track, off2, count) / np.bincount(track, minlength=count)
    )


def _means(values: PointsNx2, weights: Vector, track: Indices, total: Vector) -> PointsNx2:
    return np.stack([np.bincount(track, weights * values[:, k]) / total for k in (0, 1)], axis=1)
