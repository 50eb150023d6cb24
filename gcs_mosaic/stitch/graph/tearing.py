"""Map quality from held-out matches: how far two frames place the same ground point apart.

Registration accepts what agrees with one homography, so its inliers alone would flatter the map: of objects above ground they
include only the lowest. Other tentative matches count as well if their two frames, at their poses, see one point there within
the expected heights, as accurately as the inliers. The rest are considered false. A bad map cannot hide that way: inliers count
however badly they fit.

Pairs of frames have almost equal weight, because matches pile up between frames taken from the same place.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from gcs_mosaic.stitch.arrays import AnyArray, AnyPairsNx2, IndexPairsNx2, Indices, Mask, PointsNx2, Vector
from gcs_mosaic.stitch.camera.geometry import Camera, Pose, canvas_from_pixels
from gcs_mosaic.stitch.camera.relief import ReliefDisplacement, ReliefSettings, on_plane
from gcs_mosaic.stitch.features.extraction import Features
from gcs_mosaic.stitch.graph.view_graph import ViewGraph
from gcs_mosaic.stitch.transaction import Kept

logger = logging.getLogger(__name__)

T = TypeVar("T")

# pairs of an island sampled evenly: half a second at 3,000 frames, and the 95 % is accurate to some 4 %
PAIRS = 500
PER_PAIR = 32  # held-out matches sampled evenly from a pair
COUNTING = 8  # maximum weight of a pair, in matches; 3 to 16 give the same within a tenth
FEWEST = 20  # held-out inliers an island needs
HIGHEST = 3.0  # standard deviations of the expected heights
PER_GROWTH = 16  # an island is measured again when it has grown by one part in so many


@dataclass(frozen=True, slots=True)
class HeldOut:
    """Held-out match error of an island, in pixels of its median frame; infinite above a horizon."""

    median_px: float
    p95_px: float
    matches: int  # number of matches measured


class Tearing(Kept):
    """Measures the islands of a graph, each after its adjustment or growth."""

    FIXED = frozenset({"_graph", "_settings"})

    def __init__(self, graph: ViewGraph, settings: ReliefSettings) -> None:
        self._graph = graph
        self._settings = settings
        self._known: dict[int, tuple[int, HeldOut | None]] = {}  # with the number of frames then, by island

    def forget(self, island: int) -> None:
        """To be called when an island has been adjusted."""
        self._known.pop(island, None)

    def forget_all(self) -> None:
        """At the end of a flight: the next figures are exact."""
        self._known.clear()

    def of_islands(self) -> dict[int, HeldOut]:
        """Figures of all islands that have any; cheap where little has changed."""
        found = {}
        for island, frames in self._graph.frame_counts().items():
            before, known = self._known.get(island, (0, None))
            if not before <= frames < before + max(1, before // PER_GROWTH):
                known = self._measured(island)
                self._known[island] = frames, known
            if known is not None:
                found[island] = known
        return found

    def _measured(self, island: int) -> HeldOut | None:
        try:
            return torn_apart(self._graph, island, self._settings)
        except Exception:  # failing to measure the map must not end a flight
            logger.exception("island %d could not be judged", island)
            return None


@dataclass(frozen=True, slots=True)
class HeldOutMatches:
    """Matches of frames a and b that took no part in their placement: features (n, 2) of inliers and (d, 2) of others."""

    frames: tuple[int, int]
    inliers: AnyPairsNx2
    doubtful: AnyPairsNx2


@dataclass(frozen=True, slots=True)
class FrameInPlace:
    """A placed frame with its features' places and its relief."""

    features: Features
    pose: Pose
    camera: Camera
    relief: ReliefDisplacement | None


@dataclass(frozen=True, slots=True)
class _Matches:
    """Held-out matches of pairs of frames, m in all."""

    pair: Indices  # (m,) number of the pair
    is_inlier: Mask  # (m,)
    frames: IndexPairsNx2  # (m, 2)
    features: IndexPairsNx2  # (m, 2)


@dataclass(frozen=True, slots=True)
class _Sights:
    """Canvas places of observations, n in all."""

    painted: PointsNx2  # (n, 2) on the canvas
    level: PointsNx2  # (n, 2) the same without relief, on the plane
    by_height: PointsNx2  # (n, 2) shift per unit of ground height


def torn_apart(graph: ViewGraph, island: int, settings: ReliefSettings) -> HeldOut | None:
    """Held-out match error of an island; None with too few matches."""
    members = graph.members(island).tolist()
    inside = set(members)
    keys = some_of([key for key in graph.links if key[0] in inside and key[1] in inside])
    matches = [HeldOutMatches(key, graph.links[key].held_out, graph.links[key].doubtful) for key in keys]
    seen = {frame: graph.frames[frame] for key in keys for frame in key}
    frames = {
        frame: FrameInPlace(state.features, graph.pose_of(frame), graph.camera_of(frame), state.relief)
        for frame, state in seen.items()
    }
    return held_out_error(matches, frames, [(graph.pose_of(f), graph.camera_of(f)) for f in members], settings)


def some_of(pairs: Sequence[T]) -> Sequence[T]:
    """Of all pairs of an island's frames those to be measured."""
    return pairs[:: -(-len(pairs) // PAIRS) or 1]


def held_out_error(
    matches: Sequence[HeldOutMatches],
    frames: Mapping[int, FrameInPlace],
    views: Iterable[tuple[Pose, Camera]],
    settings: ReliefSettings,
) -> HeldOut | None:
    """Error of these matches, None with too few. `views`: pose and camera of all frames of the island."""
    sampled = _sampled(matches)
    if np.count_nonzero(sampled.is_inlier) < FEWEST:
        return None
    gsd, height = _usual(views)
    sights = _sights(frames, sampled.frames.ravel(), sampled.features.ravel())
    believed = sampled.is_inlier | _as_good_as_inliers(sights, sampled.is_inlier, HIGHEST * settings.sigma * height)
    apart = np.linalg.norm(sights.painted[::2] - sights.painted[1::2], axis=1)[believed]
    apart = np.where(np.isfinite(apart), apart, np.inf) / gsd
    _, pair, counts = np.unique(sampled.pair[believed], return_inverse=True, return_counts=True)
    median, p95 = quantiles(apart, np.minimum(1, COUNTING / counts[pair]), (0.5, 0.95))
    return HeldOut(median, p95, len(apart))


def _sampled(links: Sequence[HeldOutMatches]) -> _Matches:
    """At most PER_PAIR matches of each pair."""
    features = [np.concatenate([link.inliers, link.doubtful]) for link in links]
    chosen = [np.arange(0, len(both), -(-len(both) // PER_PAIR) or 1) for both in features]
    counts = [len(some) for some in chosen]
    return _Matches(
        pair=np.arange(len(links)).repeat(counts),
        is_inlier=_joined([some < len(link.inliers) for some, link in zip(chosen, links, strict=True)], bool),
        frames=np.array([link.frames for link in links], np.intp).reshape(-1, 2).repeat(counts, axis=0),
        features=_joined([both[some] for both, some in zip(features, chosen, strict=True)], np.intp).reshape(-1, 2),
    )


def _joined(parts: Sequence[AnyArray], kind: type) -> AnyArray:
    return np.concatenate(parts).astype(kind) if parts else np.empty(0, kind)


def _sights(placed: Mapping[int, FrameInPlace], frames: Indices, features: Indices) -> _Sights:
    """Where these frames (n,) see these of their features (n,)."""
    painted, level, by_height = np.empty((3, len(frames), 2))
    order = np.argsort(frames, kind="stable")
    for own in np.split(order, np.flatnonzero(np.diff(frames[order])) + 1):
        frame = placed[int(frames[own[0]])]
        pose, camera = frame.pose, frame.camera
        pixels = frame.features.points[features[own]].astype(np.float64)
        both = np.concatenate([on_plane(frame.relief, camera, pixels), pixels])
        painted[own], level[own] = canvas_from_pixels(pose, camera, both).reshape(2, -1, 2)
        by_height[own] = ([pose.x, pose.y] - level[own]) / (math.exp(pose.log_gsd) * camera.focal_px)
    return _Sights(painted, level, by_height)


def _as_good_as_inliers(sights: _Sights, is_inlier: Mask, highest: float) -> Mask:
    """Matches (m,) consistent with one point of plausible height, with errors below the inliers' 95th percentile."""
    miss = sights.level[1::2] - sights.level[::2]
    parallax = sights.by_height[::2] - sights.by_height[1::2]
    height = (miss * parallax).sum(axis=1) / np.maximum((parallax**2).sum(axis=1), 1e-12)
    off = np.linalg.norm(miss - height.clip(-highest, highest)[:, None] * parallax, axis=1)
    off = np.where(np.isfinite(off), off, np.inf)
    return np.asarray(off < quantiles(off[is_inlier], np.ones(np.count_nonzero(is_inlier)), (0.95,))[0])


def quantiles(values: Vector, weights: Vector, shares: Sequence[float]) -> list[float]:
    """Weighted quantiles of the values."""
    order = np.argsort(values)
    heaped = np.cumsum(weights[order])
    last = len(values) - 1
    return [float(values[order[min(int(np.searchsorted(heaped, share * heaped[-1])), last)]]) for share in shares]


def _usual(views: Iterable[tuple[Pose, Camera]]) -> tuple[float, float]:
    """Canvas units per pixel of the median frame, and the median height above the plane in canvas units."""
    both = np.array([(math.exp(pose.log_gsd), math.exp(pose.log_gsd) * camera.focal_px) for pose, camera in views])
    gsd, height = np.median(both, axis=0)
    return float(gsd), float(height)
