"""Outcome of a frame given to the mosaic."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gcs_mosaic.stitch.arrays import Matrix3x3
from gcs_mosaic.stitch.camera import geometry
from gcs_mosaic.stitch.camera.geometry import Camera, Pose
from gcs_mosaic.stitch.camera.picture_area import PictureArea
from gcs_mosaic.stitch.camera.relief import ReliefDisplacement
from gcs_mosaic.stitch.camera.still_mask import StillMask
from gcs_mosaic.stitch.graph.view_graph import ViewGraph

Homography = tuple[tuple[float, ...], ...]  # 3x3, row by row


@dataclass(frozen=True, slots=True)
class Placement:
    """Pose of a frame on its island's canvas, and how well it is supported."""

    name: str
    island: int
    pose: Pose
    camera: Camera
    relief: ReliefDisplacement | None  # shifts by terrain height in this frame; None while unknown
    inliers: int  # independent inliers, over all neighbours
    residual_px: float  # median over its matches, full-resolution pixels; NaN for a founder
    neighbours: tuple[str, ...]  # frames it is linked with
    hops: int  # links between it and the root of its island, the founding frame
    # Standard deviation of its least certain corner relative to the root, full-resolution pixels; infinite where the matches do
    # not determine it. It propagates match noise, not relief.
    corner_deviation_px: float
    # For a frame placed by a free homography (`--method paper`); `pose` is then only the nearest level pose.
    homography: Homography | None = None
    aircraft: int | None = None  # that carried the camera, where several are told apart
    still: StillMask | None = None  # what an overlay covers in its picture, as far as that is known
    area: PictureArea | None = None  # where it holds a picture; None: everywhere
    focal_log_deviation: float | None = (
        None  # standard deviation of the log of its focal length; None while not estimated
    )

    @property
    def canvas_from_frame(self) -> Matrix3x3:
        """Homography (3x3) from full-resolution pixels to the canvas that best fits pose and lens, or the free one."""
        return (
            geometry.canvas_from_frame(self.pose, self.camera) if self.homography is None else np.array(self.homography)
        )


@dataclass(frozen=True, slots=True)
class Covered:
    """A frame that shows nothing new beyond the placed frame `by`, its keyframe; its position follows that frame's."""

    name: str
    by: str
    by_from_frame: Homography  # full-resolution pixels of this frame to those of its keyframe

    def canvas_from_frame(self, keyframe: Placement) -> Matrix3x3:
        """Homography (3x3) from full-resolution pixels to the canvas, given its keyframe's placement."""
        canvas_from_frame = keyframe.canvas_from_frame @ np.array(self.by_from_frame)
        return np.asarray(canvas_from_frame / canvas_from_frame[2, 2])


@dataclass(frozen=True, slots=True)
class Waiting:
    """A frame without matches yet; retried when new ground is known."""

    name: str


@dataclass(frozen=True, slots=True)
class Rejection:
    """A frame that is not placed, and why."""

    name: str
    reason: str


Outcome = Placement | Covered | Waiting | Rejection


def placement_of(graph: ViewGraph, frame: int) -> Placement:
    """Present placement of a placed frame of the graph."""
    state = graph.frames[frame]
    return Placement(
        name=state.name,
        island=graph.island_of(frame),
        pose=graph.pose_of(frame),
        camera=graph.camera_of(frame),
        relief=state.relief,
        inliers=sum(state.inliers.values()),
        residual_px=state.residual_px,
        neighbours=tuple(graph.frames[other].name for other in sorted(state.inliers)),
        hops=state.hops,
        corner_deviation_px=state.corner_deviation_px,
        aircraft=graph.aircraft_of[state.camera],
        still=state.features.still,
        area=state.features.area,
        focal_log_deviation=graph.lenses[graph.island_of(frame), state.camera].focal_log_deviation,
    )
