"""How well each placed frame is supported: hops to the root and corner deviations."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

import numpy as np

from gcs_mosaic.stitch.arrays import Vector
from gcs_mosaic.stitch.camera.geometry import Pose
from gcs_mosaic.stitch.graph.view_graph import ViewGraph


def note_adjusted(graph: ViewGraph, island: int, members: Sequence[int], deviations_px: Vector) -> None:
    """After the adjustment of a whole island: record its members' deviations and their hops to the root."""
    hops = hops_from(graph, graph.roots[island])
    for frame, deviation_px in zip(members, deviations_px.tolist(), strict=True):
        graph.note(frame, hops=hops[frame], corner_deviation_px=deviation_px)


def note_resected(graph: ViewGraph, frame: int, pose: Pose, deviation_px: float) -> None:
    """Uncertainty of a frame resected against its neighbours: theirs, plus its own relative to them.

    Neighbours share most of their error, so theirs counts once: the mean of their variances, weighted by inliers. A frame that
    extends far beyond its neighbours is less certain than stated; the island's next adjustment gives the exact value.
    """
    neighbours = graph.frames[frame].inliers
    deviations_px = [_seen_from(graph, pose, other) for other in neighbours]
    theirs = np.average(np.square(deviations_px), weights=list(neighbours.values()))
    hops = 1 + min(graph.frames[other].hops for other in neighbours)
    graph.note(frame, hops=hops, corner_deviation_px=math.sqrt(deviation_px**2 + float(theirs)))


def _seen_from(graph: ViewGraph, pose: Pose, other: int) -> float:
    """A frame's deviation in pixels of a camera at this pose."""
    return graph.frames[other].corner_deviation_px * math.exp(graph.pose_of(other).log_gsd - pose.log_gsd)


def hops_from(graph: ViewGraph, root: int) -> dict[int, int]:
    """Fewest links from the root to each connected frame, breadth first."""
    hops, waiting = {root: 0}, deque([root])
    while waiting:
        frame = waiting.popleft()
        for other in graph.frames[frame].inliers:
            if other not in hops:
                hops[other] = hops[frame] + 1
                waiting.append(other)
    return hops
