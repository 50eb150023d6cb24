"""A frame's pixels of places on a plane parallel to the canvas, above or below it.

A place at a height is seen on the canvas where the ray through it meets the canvas: away from the camera's nadir by the factor
H / (H - height), H the camera's height. Relief then shifts it as it shifts the ground there, so that a height counts from the
map's ground. A focal length that is wrong by a factor makes all heights of cameras wrong by nearly that factor, and with them
those of planes in focus; heights as shares of the flying height stay right.
"""

from __future__ import annotations

import math

import numpy as np

from gcs_mosaic.stitch.arrays import PointsNx2, Vector
from gcs_mosaic.stitch.camera.geometry import Camera, Pose, pixels_from_canvas
from gcs_mosaic.stitch.camera.relief import ReliefDisplacement, as_seen


def camera_height(pose: Pose, camera: Camera) -> float:
    """Canvas units above the canvas."""
    return math.exp(pose.log_gsd) * camera.focal_px


def pixels_at(
    pose: Pose, camera: Camera, relief: ReliefDisplacement | None, places: PointsNx2, height: float | Vector
) -> PointsNx2:
    """Frame pixels (n, 2) of canvas places (n, 2) at a height in canvas units, the same of all or of each (n,); NaN where the
    lens cannot see them."""
    above = camera_height(pose, camera)
    below = above - np.asarray(height, np.float64)
    nadir = np.array([pose.x, pose.y])
    on_canvas = nadir + (places - nadir) * (above / np.where(below > 0, below, np.nan))[..., None]
    return as_seen(relief, camera, pixels_from_canvas(pose, camera, on_canvas))


def direction_to(pose: Pose, camera: Camera, place: Vector, height: float) -> Vector:
    """Unit vector (3,) from a canvas place (2,) at a height to the camera: x, y, up."""
    towards = np.array([pose.x - place[0], pose.y - place[1], camera_height(pose, camera) - height])
    return np.asarray(towards / np.linalg.norm(towards))
