"""Covered frames: a placed frame, the keyframe, shows all their ground, at no lower resolution or sharpness.

A video or a hovering aircraft takes many images of one place, and each would be matched with a dozen others. One registration
shows that a frame is covered: it is then kept relative to its keyframe and takes no further part. It is compared with the
keyframe alone, never with another covered frame, so that slow drift does not accumulate.
"""

from __future__ import annotations

from collections.abc import Container, Iterator, Mapping
from dataclasses import dataclass

import cv2
import numpy as np

from gcs_mosaic.stitch.arrays import Matrix3x3, PointsNx2, Vector2
from gcs_mosaic.stitch.camera.geometry import Camera, canvas_from_pixels, pixels_from_canvas
from gcs_mosaic.stitch.features.extraction import Features
from gcs_mosaic.stitch.graph.candidates import Search
from gcs_mosaic.stitch.graph.neighbours import boxes_meet, boxes_shared
from gcs_mosaic.stitch.graph.placement import Covered
from gcs_mosaic.stitch.graph.view_graph import ViewGraph
from gcs_mosaic.stitch.registration.a_contrario import confirmed
from gcs_mosaic.stitch.registration.outcome import Registration

Compared = Mapping[int, Registration | None]  # results of a frame's comparisons by frame

CANDIDATES = 4  # placed frames whose overlap with a new one is computed; bounding boxes alone mislead


@dataclass(frozen=True, slots=True, kw_only=True)
class CoverSettings:
    """When a frame is kept without being placed, because a placed one covers it."""

    enabled: bool = True  # false: every frame is placed and painted, at the cost of one over new ground
    # share of a frame that the keyframe may lack; where aircraft moved on, recorded flights have 0.03 and more
    most_new: float = 0.025
    most_finer: float = 1.03  # maximum ratio of the keyframe's ground sampling distance to the frame's
    # maximum ratio of `sharpness`: 0.7 px of blur gives 1.1 to 1.7, 3 px of motion blur 1.1 to 1.8, compression 0.9 to 1.1,
    # lighting 1
    most_sharper: float = 1.2
    least_confirmed: float = 0.5  # share of the overlap that matches confirm; less certain frames are placed normally


class Covering:
    """Checks whether frames are covered by those of a graph. Stateless."""

    def __init__(self, graph: ViewGraph, search: Search, settings: CoverSettings) -> None:
        self._graph = graph
        self._search = search
        self._settings = settings

    def look(self, name: str, features: Features, previews: Container[str] = ()) -> Covered | Compared:
        """Whether a frame that is not in the graph yet is covered; if not, the results of the comparisons made. `previews` cover
        nothing: they are, or will be, covered themselves.

        The search for the next frame begins at this one's keyframe.
        """
        graph, compared = self._graph, dict[int, Registration | None]()
        if not self._settings.enabled or not graph.merged_into:
            return compared
        last = graph.last_placed
        compared[last] = self._search.compare(name, features, last)
        keyframes = self._keyframes(features, last, compared[last])
        for keyframe in (one for one in keyframes if graph.frames[one].name not in previews):
            if keyframe not in compared:
                compared[keyframe] = self._search.compare(name, features, keyframe)
            link = compared[keyframe]
            if link is not None and self._is_covered(features, keyframe, link):
                graph.last_placed, graph.placed_before = keyframe, None
                by_from_frame = link.b_from_a / link.b_from_a[2, 2]
                return Covered(name, graph.frames[keyframe].name, tuple(map(tuple, by_from_frame.tolist())))
        return compared

    def _keyframes(self, features: Features, last: int, link: Registration | None) -> Iterator[int]:
        """The frame placed last, then the one that should cover this frame best by its pose; each if it may."""
        if link is None:
            return
        if self._may_cover(features, last):
            yield last
        others = {other: share for other, share in self._shares(features, last, link) if other != last}
        best = max(others, key=lambda other: (others[other], -other), default=None)
        if best is not None and others[best] >= 1 - self._settings.most_new:
            yield best

    def _shares(self, features: Features, last: int, link: Registration) -> Iterator[tuple[int, float]]:
        """Frames around that may cover this one, with the share of it that each should see."""
        graph = self._graph
        outline = _mapped(link.b_from_a, _corners(features))
        places = canvas_from_pixels(graph.pose_of(last), graph.camera_of(last), outline)
        if not np.isfinite(places).all():
            return  # it sees the horizon, beyond which the ground homography is undefined
        box = np.concatenate([places.min(axis=0), places.max(axis=0)])
        members = graph.members(graph.island_of(last))
        members = members[boxes_meet(box, graph.boxes[members])]
        likely = np.argsort(-boxes_shared(box, graph.boxes[members]), kind="stable")[:CANDIDATES]
        for other in members[likely].tolist():
            if self._may_cover(features, other):
                camera = graph.camera_of(other)
                yield other, _share_inside(pixels_from_canvas(graph.pose_of(other), camera, places), camera)

    def _may_cover(self, features: Features, other: int) -> bool:
        """Whether a placed frame is from the same camera (another may show different things) and not clearly less sharp."""
        placed = self._graph.frames[other].features
        if placed.area is not None:  # what it shows is less than its frame
            return False
        same = (placed.width, placed.height) == (features.width, features.height)
        same &= self._graph.aircraft_of[self._graph.frames[other].camera] == self._graph.aircraft
        return same and features.sharpness <= self._settings.most_sharper * placed.sharpness

    def _is_covered(self, features: Features, keyframe: int, link: Registration) -> bool:
        """Whether a frame registered with one that may cover it adds neither ground nor resolution."""
        outline, camera = _mapped(link.b_from_a, _corners(features)), self._graph.camera_of(keyframe)
        if _share_inside(outline, camera) < 1 - self._settings.most_new:
            return False
        area = cv2.contourArea(outline.astype(np.float32)) / (features.width * features.height)
        if area * self._settings.most_finer**2 < 1:
            return False
        placed = self._graph.frames[keyframe].features
        found = _mapped(np.asarray(np.linalg.inv(link.b_from_a), dtype=np.float64), placed.points.astype(np.float64))
        share = confirmed(features.points.astype(np.float64), found, link.pixels_a).share
        return share >= self._settings.least_confirmed


def _corners(features: Features) -> PointsNx2:
    """The frame's outer corners (4, 2) in pixels, clockwise."""
    unit = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    return unit * [features.width, features.height] - 0.5


def _mapped(homography: Matrix3x3, points: PointsNx2) -> PointsNx2:
    return np.asarray(cv2.perspectiveTransform(points[None], homography)[0])


def _share_inside(outline: PointsNx2, camera: Camera) -> float:
    """Share, by area, of a quadrilateral outline (4, 2) in a frame's pixels that lies inside the frame; 0 if not convex."""
    quad = (outline + 0.5).astype(np.float32)
    if not np.isfinite(quad).all() or not cv2.isContourConvex(quad):
        return 0.0
    whole = common = quad.astype(np.float64)
    for axis, size in enumerate((camera.width, camera.height)):
        common = _cut(_cut(common, axis, 1.0, 0.0), axis, -1.0, float(size))
    return _area(common) / max(_area(whole), 1e-9)


def _cut(polygon: PointsNx2, axis: int, sign: float, offset: float) -> PointsNx2:
    """The part of a convex polygon (n, 2) where sign * coordinate + offset >= 0 (Sutherland and Hodgman, CACM 17(1), 1974).

    OpenCV 4.10 returns wrong intersections of polygons with common sides.
    """
    kept: list[Vector2] = []
    for here, there in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        a, b = sign * here[axis] + offset, sign * there[axis] + offset
        kept += [here] if a >= 0 else []
        kept += [here + (there - here) * (a / (a - b))] if (a >= 0) != (b >= 0) else []
    return np.array(kept).reshape(-1, 2)


def _area(polygon: PointsNx2) -> float:
    x, y = polygon.T
    return float(abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2)
