"""The other plane that explains what a few frames show of one.

Of two views of a plane there are two explanations: another plane, seen by a camera that turns (R. Y. Tsai and T. S. Huang,
"Estimating three-dimensional motion parameters of a rigid planar patch", IEEE ASSP 29, 1981). Of a camera that looks ahead by 60
degrees and flies straight on, the other one is less tilted, at first, so that the prior of level flight prefers it. A third view
tells them apart, and the more the longer the line, but no small steps lead from one to the other.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache

import numpy as np

from gcs_mosaic.stitch.arrays import AnyArray, Matrices, PosesNx6, Vector
from gcs_mosaic.stitch.camera.geometry import Camera, Pose, pinhole_homography, pose_from_homography, rotation_matrix
from gcs_mosaic.stitch.camera.projection import pose_row

STEEPEST, STEP = 75, 5  # degrees: of a frame's tilt, and between those that are tried
TURNS = 24  # directions of tilt
APART = math.radians(15)  # what is nearer to the present plane is where the adjustment came from
UNLIKE = 0.1  # mean distance of the homographies from those of a camera, beyond which no adjustment would come there


def other_poses(poses: PosesNx6, cameras: Sequence[Camera]) -> PosesNx6 | None:
    """Poses (n, 6) over the plane, tilted otherwise, that explains best what these (n, 6) show of theirs, each with its camera;
    roughly, to begin an adjustment with. None if there is none."""
    views = [(Pose(*pose), camera) for pose, camera in zip(poses.tolist(), cameras, strict=True)]
    homographies = np.stack([pinhole_homography(pose, camera) for pose, camera in views])
    pose, camera = views[len(views) // 2]
    tilts = _tilts()
    tilts = tilts[tilts @ pose.rotation()[2] < math.cos(APART)]
    rays = np.stack([_pixel_from_ray(one) for one in cameras])
    own = np.linalg.inv(homographies[len(views) // 2] @ rays[len(views) // 2])
    planes = np.stack([_canvas_from_ray(pose, camera, normal) for normal in tilts]) @ own  # other from present canvas
    unlike = _unlike(planes[:, None] @ (homographies @ rays))
    best = int(np.argmin(unlike))
    if not unlike[best] < UNLIKE:
        return None
    found = [pose_from_homography(planes[best] @ one, of) for one, of in zip(homographies, cameras, strict=True)]
    known = [pose_row(one) for one in found if one is not None]
    return np.array(known) if len(known) == len(found) else None


@cache
def _tilts() -> AnyArray:
    """The plane's normals (k, 3) that are tried, in a frame's own directions."""
    tilts = np.radians(np.arange(STEP, STEEPEST + STEP, STEP))
    turns = np.arange(TURNS) * (2 * math.pi / TURNS)
    tilt, turn = (one.ravel() for one in np.meshgrid(tilts, turns))
    beside = np.column_stack([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt)])
    return np.vstack([[0.0, 0.0, 1.0], beside])


def _pixel_from_ray(camera: Camera) -> AnyArray:
    axis_x, axis_y = camera.principal_point
    return np.array([[camera.focal_px, 0, axis_x], [0, camera.focal_px, axis_y], [0, 0, 1]])


def _canvas_from_ray(pose: Pose, camera: Camera, normal: Vector) -> AnyArray:
    """Of the frame at its place and height, but tilted so that the plane's normal is this one in its own directions."""
    height = math.exp(pose.log_gsd) * camera.focal_px
    pitch, roll = math.asin(-normal[0]), math.atan2(normal[1], normal[2])
    canvas_from_ray = np.array([[height, 0, pose.x], [0, height, pose.y], [0, 0, 1]])
    return canvas_from_ray @ rotation_matrix(pose.yaw, pitch, roll)


def _unlike(canvas_from_rays: Matrices) -> Vector:
    """How unlike those of a camera that looks down homographies (k, n, 3, 3) are, rays to canvas: mean (k,) over n; infinite if
    one looks up, or is mirrored. Of a camera's, but for the third row, rows are of one length and at right angles."""
    rows = canvas_from_rays / np.linalg.norm(canvas_from_rays[..., 2:, :], axis=-1, keepdims=True)
    rows = rows * np.where(rows[..., 2:, 2:] > 0, 1.0, -1.0)
    nadir = rows[..., :2, :] @ rows[..., 2, :, None]
    across = rows[..., :2, :] - nadir * rows[..., 2:, :]
    lengths = np.linalg.norm(across, axis=-1)
    height = np.maximum(lengths.mean(axis=-1), 1e-12)
    angle = (across[..., 0, :] * across[..., 1, :]).sum(axis=-1) / height**2
    unlike = np.hypot((lengths[..., 0] - lengths[..., 1]) / height, angle)
    return np.where((np.linalg.det(rows) > 0).all(axis=-1), unlike.mean(axis=-1), np.inf)
