"""What the frames of an island see of the same points, by their matches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gcs_mosaic.stitch.arrays import Counts, FeaturePairsNx2, IndexPairsNx2, Indices, Points32Nx2, PointsNx2, Vector
from gcs_mosaic.stitch.bundle.relief_points import tracks
from gcs_mosaic.stitch.graph.view_graph import ViewGraph


@dataclass(frozen=True, slots=True)
class MatchedPoints:
    """All matches of p linked pairs among n frames, k in all, as stored; quick to gather. See `sightings`."""

    pairs: IndexPairsNx2  # (p, 2) rows of the frames, 0 to n - 1
    counts: Counts  # (p,) number of matches of each pair
    features: FeaturePairsNx2  # (k, 2) feature index in either frame
    points: Points32Nx2  # (f, 2) pixels of the features of all frames, frame by frame
    lengths: Counts  # (n,) number of features of each frame
    scales: Vector  # (n,) full-resolution pixels per pixel of the frame's feature picture


@dataclass(frozen=True, slots=True)
class Sightings:
    """Observations of ground points by n frames, m in all."""

    row: Indices  # (m,) the frame, 0 to n - 1
    pixels: PointsNx2  # (m, 2)
    point: Indices  # (m,)
    scales: Vector  # (n,) as in `Matched`


def matched(graph: ViewGraph, frames: Sequence[int], of: Sequence[int] | None = None) -> MatchedPoints | None:
    """The matches of all links between these frames, or only of the links `of` some of them; None without links."""
    row = {frame: number for number, frame in enumerate(frames)}
    ends = {(f, o) for f in (of or frames) for o in graph.frames[f].inliers if o in row}
    keys = sorted({(a, b) if (a, b) in graph.links else (b, a) for a, b in ends})
    if not keys:
        return None
    matches = [graph.links[key].features for key in keys]
    features = [graph.frames[frame].features for frame in frames]
    return MatchedPoints(
        pairs=np.array([(row[a], row[b]) for a, b in keys], dtype=np.intp),
        counts=np.array([len(some) for some in matches], dtype=np.intp),
        features=np.concatenate(matches),
        points=np.concatenate([one.points for one in features]),
        lengths=np.array([len(one) for one in features], dtype=np.intp),
        scales=np.array([one.scale for one in features]),
    )


def sightings(matches: MatchedPoints) -> Sightings:
    """Observations from matches: a feature matched in several pairs is one ground point."""
    first = np.concatenate([[0], np.cumsum(matches.lengths)[:-1]])
    ends = first[matches.pairs].repeat(matches.counts, axis=0) + matches.features
    seen, nodes = np.unique(ends, return_inverse=True)
    row = np.searchsorted(first, seen, side="right") - 1
    found = tracks(nodes.reshape(-1, 2), row)
    kept = seen[found.nodes]
    return Sightings(row[found.nodes], matches.points[kept].astype(np.float64), found.track, matches.scales)
