"""What became of a frame that was given to the mosaic."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gcs_mosaic.stitch.camera import geometry
from gcs_mosaic.stitch.camera.geometry import Array, Camera, Pose
from gcs_mosaic.stitch.camera.relief import ReliefDisplacement
from gcs_mosaic.stitch.graph.view_graph import ViewGraph

Homography = tuple[tuple[float, ...], ...]  # 3x3, row by row


@dataclass(frozen=True, slots=True)
class Placement:
    """Where a frame lies on its island's canvas, and how well that is supported."""

    name: str
    island: int
    pose: Pose
    camera: Camera
    relief: ReliefDisplacement | None  # what heights shift in this frame; None while nothing is known of them
    inliers: int  # independent ones, over all neighbours
    residual_px: float  # median over its matches, full-resolution pixels; NaN for a founder
    neighbours: tuple[str, ...]  # the frames it is linked with
    hops: int  # links between it and the root of its island, the frame that founded it
    # Standard deviation of its least certain corner relative to the root, full-resolution pixels; infinite where the
    # matches leave it open. It tells what noise of the matches does, not what hills do.
    corner_deviation_px: float
    # Where the frame was laid by a free homography (`--method paper`); then `pose` is only the level one nearest to it.
    homography: Homography | None = None

    @property
    def canvas_from_frame(self) -> Array:
        """The homography (3x3) from full-resolution pixels to the canvas that fits pose and lens best, or the free one."""
        return (
            geometry.canvas_from_frame(self.pose, self.camera) if self.homography is None else np.array(self.homography)
        )


@dataclass(frozen=True, slots=True)
class Covered:
    """A frame that shows nothing which the placed frame `by`, its keyframe, does not; it lies where that one lies."""

    name: str
    by: str
    by_from_frame: Homography  # full-resolution pixels of this frame to those of its keyframe

    def canvas_from_frame(self, keyframe: Placement) -> Array:
        """The homography (3x3) from full-resolution pixels to the canvas, as its keyframe lies."""
        canvas_from_frame = keyframe.canvas_from_frame @ np.array(self.by_from_frame)
        return np.asarray(canvas_from_frame / canvas_from_frame[2, 2])


@dataclass(frozen=True, slots=True)
class Waiting:
    """A frame that matches nothing yet; it is tried again when new ground is known."""

    name: str


@dataclass(frozen=True, slots=True)
class Rejection:
    """A frame that will not be placed, and why."""

    name: str
    reason: str


Outcome = Placement | Covered | Waiting | Rejection


def placement_of(graph: ViewGraph, frame: int) -> Placement:
    """How a placed frame of the graph lies now."""
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
    )
