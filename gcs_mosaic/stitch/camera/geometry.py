"""Camera over a plane: from frame pixels to the canvas and back.

Conventions, used throughout this package:

* Frame pixels: OpenCV's convention, the centre of the top-left pixel is (0, 0), x right, y down.
* Canvas: x right, y down; the ground is the canvas plane. One unit is one full-resolution pixel of an island's first frame.
* Camera axes: x right, y down, z forward. A frame with yaw = pitch = roll = 0 looks straight down, its x along the canvas' x.
* Lens: two radial terms as in OpenCV, `distorted = undistorted * (1 + k1 * r**2 + k2 * r**4)`, radii in focal lengths from the
  principal point (Brown, Photogrammetric Engineering 37(8), 1971). Of a fisheye the same of the angle to the axis, also as in
  OpenCV: `distorted = angle * (1 + k1 * angle**2 + k2 * angle**4)` (Kannala and Brandt, IEEE PAMI 28(8), 2006). Of one of 110
  degrees across its diagonal the first is 20 px off in the corner of 12 megapixels, of one of 150 degrees 250 px.
* Transforms are named target_from_source; points are (n, 2) float64 arrays; NaN means "nowhere" (behind the camera, above the
  horizon, outside the lens model's range).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Annotated

import cv2
import numpy as np

from gcs_mosaic.stitch.arrays import Mask, Matrix3x3, PointsNx2, Rows2xN, Vector, Vector2

UNDISTORT_STEPS = 8  # Newton iterations on the radius; 5 reach 1e-9 for |k1| <= 0.3, the rest is margin
LEAST_SLOPE = 0.02  # of the lens' radius curve; where it is flatter, the Newton step is limited
HORIZON_COSINE = 0.02  # rays within about 1 degree of the horizon meet the ground too far away to be useful


@dataclass(frozen=True, slots=True)
class Camera:
    """Intrinsics shared by all frames of one camera; all but the size is estimated from matches, never given.

    Lengths are in half-diagonals, independent of the frame's size.
    """

    width: Annotated[int, "px"]
    height: Annotated[int, "px"]
    focal: float = 1.5
    k1: float = 0.0
    k2: float = 0.0
    shift_x: Annotated[float, "of the principal point from the middle of the frame"] = 0.0
    shift_y: float = 0.0
    fisheye: Annotated[bool, "k1 and k2 are of the angle to the axis, not of its tangent"] = False

    @property
    def half_diagonal(self) -> float:
        return math.hypot(self.width, self.height) / 2

    @property
    def focal_px(self) -> float:
        return self.focal * self.half_diagonal

    @property
    def centre(self) -> Vector2:
        """Centre of the frame in pixels, (2,)."""
        return np.array([(self.width - 1) / 2, (self.height - 1) / 2])

    @property
    def principal_point(self) -> Vector2:
        """Principal point in pixels, (2,)."""
        return self.centre + np.array([self.shift_x, self.shift_y]) * self.half_diagonal

    @property
    def is_pinhole(self) -> bool:
        return self.k1 == 0 and self.k2 == 0 and not self.fisheye

    @property
    def reach(self) -> float:
        """Radius (undistorted, in focal lengths; of a fisheye the angle) at which the distortion would fold the image back; often
        infinite."""
        reach = _reach_of(self.k1, self.k2)
        return min(reach, math.pi / 2) if self.fisheye else reach


@dataclass(frozen=True, slots=True)
class Pose:
    """Where a frame was taken from.

    `x`, `y`: the canvas point at the camera's nadir. `log_gsd`: natural log of the ground sampling distance there (canvas units
    per pixel), so height = exp(log_gsd) * focal_px. Angles in radians; rotation = Rz(yaw) Ry(pitch) Rx(roll).
    """

    x: float
    y: float
    log_gsd: float = 0.0
    yaw: float = 0.0
    pitch: float = 0.0
    roll: float = 0.0

    def rotation(self) -> Matrix3x3:
        """Rotation canvas_from_camera, 3x3."""
        return rotation_matrix(self.yaw, self.pitch, self.roll)


View = tuple[Pose, Camera]


def rotation_matrix(yaw: float, pitch: float, roll: float) -> Matrix3x3:
    """Rz(yaw) Ry(pitch) Rx(roll), 3x3."""
    cy, sy, cp, sp, cr, sr = (f(a) for a in (yaw, pitch, roll) for f in (math.cos, math.sin))
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def canvas_from_pixels(pose: Pose, camera: Camera, pixels: PointsNx2) -> PointsNx2:
    """Canvas places (n, 2) of frame pixels (n, 2); NaN where no ground is seen."""
    flat = undistort(camera, normalised(camera, pixels).T)
    rays = pose.rotation() @ np.vstack([flat, np.ones(len(pixels))])
    height = math.exp(pose.log_gsd) * camera.focal_px
    with np.errstate(divide="ignore", invalid="ignore"):
        places = np.array([[pose.x], [pose.y]]) + height * rays[:2] / rays[2]
        places[:, rays[2] < HORIZON_COSINE * np.sqrt((rays**2).sum(axis=0))] = np.nan
    return np.ascontiguousarray(places.T)


def pixels_from_canvas(pose: Pose, camera: Camera, places: PointsNx2) -> PointsNx2:
    """Frame pixels (n, 2) of canvas places (n, 2), inside the frame or not; NaN where the lens cannot see them."""
    height = math.exp(pose.log_gsd) * camera.focal_px
    offsets = places.T - np.array([[pose.x], [pose.y]])
    rays = pose.rotation().T @ np.vstack([offsets, np.full(len(places), height)])
    with np.errstate(divide="ignore", invalid="ignore"):
        undistorted = rays[:2] / rays[2]
        undistorted[:, rays[2] <= 0] = np.nan
    pixels = distort(camera, undistorted) * camera.focal_px + camera.principal_point[:, None]
    return np.ascontiguousarray(pixels.T)


def reduced_view(pose: Pose, camera: Camera, width: int, height: int) -> tuple[Pose, Camera]:
    """Pose and camera of the same frame resized (same aspect ratio): its content stays where it was."""
    reduced = replace(camera, width=width, height=height)
    factor = camera.width / width
    focal = camera.focal_px / factor / reduced.half_diagonal
    return replace(pose, log_gsd=pose.log_gsd + math.log(factor)), replace(reduced, focal=focal)


def normalised(camera: Camera, pixels: PointsNx2) -> PointsNx2:
    """Pixels (n, 2) in focal lengths from the principal point."""
    away = (pixels.T - camera.principal_point[:, None]) / camera.focal_px
    return np.asarray(away.T, dtype=np.float64)


def lens_reach(k1: Vector, k2: Vector) -> Vector:
    """Smallest radius (n,) at which `r * (1 + k1 * r**2 + k2 * r**4)` stops growing; infinite where it never does."""
    root = np.sqrt(np.maximum(9 * k1**2 - 20 * k2, 0))
    with np.errstate(divide="ignore", over="ignore"):
        squared = np.where((root - 3 * k1 > 0) & (9 * k1**2 >= 20 * k2), 2 / np.maximum(root - 3 * k1, 0), np.inf)
    return np.asarray(np.sqrt(squared))


@lru_cache(maxsize=64)  # asked for at every projection, of the few lenses of a flight
def _reach_of(k1: float, k2: float) -> float:
    return float(lens_reach(np.array([k1]), np.array([k2]))[0])


# On (2, n): numpy takes several times as long along an axis of two.


def distort(camera: Camera, undistorted: Rows2xN) -> Rows2xN:
    """Apply lens distortion to (2, n); NaN beyond the radius where it would fold the image back."""
    with np.errstate(over="ignore", invalid="ignore"):  # rays almost perpendicular to the axis
        bent = undistorted * _angle_by_tangent(undistorted) if camera.fisheye else undistorted
        r2 = (bent**2).sum(axis=0)
        distorted = bent * (1 + r2 * (camera.k1 + r2 * camera.k2))
    return np.asarray(np.where(r2 < camera.reach**2, distorted, np.nan))


def undistort(camera: Camera, distorted: Rows2xN) -> Rows2xN:
    """Inverse of `distort` (Newton's method on the radius); NaN for radii that no ray reaches."""
    if camera.is_pinhole:
        return distorted
    r_distorted = np.sqrt((distorted**2).sum(axis=0))
    r, reached = undistorted_radius(r_distorted, camera.k1, camera.k2, camera.reach)
    with np.errstate(divide="ignore", invalid="ignore"):
        factor = np.where(r_distorted > 0, (np.tan(r) if camera.fisheye else r) / r_distorted, 1.0)
    return np.asarray(np.where(reached, distorted * factor, np.nan))


def _angle_by_tangent(undistorted: Rows2xN) -> Vector:
    """Angle to the axis over its tangent (n,) of rays that meet the plane in front of the camera there, (2, n)."""
    r = np.sqrt((undistorted**2).sum(axis=0))
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.where(r > 0, np.arctan(r) / r, 1.0))


def undistorted_radius(
    distorted: Vector, k1: Vector | float, k2: Vector | float, reach: Vector | float
) -> tuple[Vector, Mask]:
    """Undistorted radii (n,), and which of them exist (those beyond `reach` are clamped just inside it)."""
    r, most, by_r2, by_r4 = np.minimum(distorted, 0.99 * reach), 0.9999 * reach, 3 * k1, 5 * k2
    for _ in range(UNDISTORT_STEPS):
        r2 = r**2
        slope = np.maximum(1 + r2 * (by_r2 + by_r4 * r2), LEAST_SLOPE)
        # Not np.clip, which takes as long as all the rest on a few points.
        r = np.minimum(np.maximum(r - (r * (1 + r2 * (k1 + k2 * r2)) - distorted) / slope, 0), most)
    error = abs(r * (1 + r**2 * (k1 + k2 * r**2)) - distorted)
    return r, np.asarray(error < 1e-6)


def pixel_grid(camera: Camera, columns: int, rows: int) -> PointsNx2:
    """Regular grid over the frame's pixel centres, row by row, (rows * columns, 2)."""
    x, y = np.meshgrid(np.linspace(0, camera.width - 1, columns), np.linspace(0, camera.height - 1, rows))
    return np.column_stack([x.ravel(), y.ravel()])


def frame_border(camera: Camera, per_side: int) -> PointsNx2:
    """Points along the frame's outer edge (not the outermost pixel centres), clockwise from the top left, (4 * per_side, 2)."""
    t = np.arange(per_side) / per_side
    one, zero = np.ones_like(t), np.zeros_like(t)
    unit = np.concatenate([np.c_[t, zero], np.c_[one, t], np.c_[1 - t, one], np.c_[zero, 1 - t]])
    return np.asarray(unit * [camera.width, camera.height] - 0.5)


def footprint(pose: Pose, camera: Camera, per_side: int = 8) -> PointsNx2:
    """Footprint of the frame on the canvas, (4 * per_side, 2); NaN where its outline is above the horizon."""
    return canvas_from_pixels(pose, camera, frame_border(camera, per_side))


def ground_sampling_distance(pose: Pose, camera: Camera, pixels: PointsNx2) -> Vector:
    """Canvas units per pixel at each pixel, (n,): square root of the area a pixel covers; NaN above the horizon."""
    right, down = np.array([0.5, 0.0]), np.array([0.0, 0.5])
    dx = canvas_from_pixels(pose, camera, pixels + right) - canvas_from_pixels(pose, camera, pixels - right)
    dy = canvas_from_pixels(pose, camera, pixels + down) - canvas_from_pixels(pose, camera, pixels - down)
    return np.asarray(np.sqrt(abs(dx[:, 0] * dy[:, 1] - dx[:, 1] * dy[:, 0])))


def canvas_from_frame(pose: Pose, camera: Camera) -> Matrix3x3:
    """Homography (3x3, frame pixels to canvas) that best fits pose and lens over the frame's visible ground."""
    pixels = pixel_grid(camera, 17, 13)
    places = canvas_from_pixels(pose, camera, pixels)
    seen = np.isfinite(places).all(axis=1)
    if camera.is_pinhole or seen.sum() < 8:
        return pinhole_homography(pose, camera)
    homography, _ = cv2.findHomography(pixels[seen], places[seen] - [pose.x, pose.y], 0)
    shift = np.array([[1.0, 0, pose.x], [0, 1, pose.y], [0, 0, 1]])
    fitted = shift @ homography
    return np.asarray(fitted / fitted[2, 2])


def pinhole_homography(pose: Pose, camera: Camera) -> Matrix3x3:
    """Homography (3x3, frame pixels to canvas) of the pose ignoring its distortion, scaled to H[2, 2] = 1 where possible."""
    height = math.exp(pose.log_gsd) * camera.focal_px
    axis_x, axis_y = camera.principal_point
    ray_from_pixel = np.array([[1, 0, -axis_x], [0, 1, -axis_y], [0, 0, camera.focal_px]])
    canvas_from_ray = np.array([[height, 0, pose.x], [0, height, pose.y], [0, 0, 1]])
    homography = canvas_from_ray @ pose.rotation() @ ray_from_pixel
    return np.asarray(homography / homography[2, 2] if abs(homography[2, 2]) > 1e-12 else homography)


def pose_from_homography(homography: Matrix3x3, camera: Camera) -> Pose | None:
    """The pose whose pinhole homography (frame pixels to canvas) is closest to this one; None if none is close.

    With M = homography @ pixel_from_ray = s * canvas_from_ray(height, x, y) @ R, the last row gives s and the last row of R,
    and the rest follows; R is projected onto the rotations by polar decomposition.
    """
    axis_x, axis_y = camera.principal_point
    pixel_from_ray = np.array([[camera.focal_px, 0, axis_x], [0, camera.focal_px, axis_y], [0, 0, 1]])
    rows = homography @ pixel_from_ray
    rows /= np.linalg.norm(rows[2]) * (1 if rows[2, 2] > 0 else -1)
    x, y = rows[:2] @ rows[2]
    across = rows[:2] - np.outer([x, y], rows[2])
    height = np.linalg.norm(across, axis=1).mean()
    u, stretch, vt = np.linalg.svd(np.vstack([across / max(height, 1e-12), rows[2]]))
    rotation = u @ vt
    if np.linalg.det(rotation) < 0 or stretch[2] < LEAST_LIKENESS:
        return None
    pitch = math.asin(max(-1.0, min(1.0, -rotation[2, 0])))
    roll, yaw = math.atan2(rotation[2, 1], rotation[2, 2]), math.atan2(rotation[1, 0], rotation[0, 0])
    return Pose(float(x), float(y), math.log(height / camera.focal_px), yaw, pitch, roll)


LEAST_LIKENESS = 0.5  # smallest singular value that still counts as a rotation distorted by noise


def similarity_between(source: PointsNx2, target: PointsNx2) -> tuple[float, float, Vector2]:
    """Least-squares similarity target_from_source of points (n, 2): scale, angle in radians, shift (2,).

    Umeyama, IEEE PAMI 13(4), 1991, without reflection: `target = scale * R(angle) @ source + shift`.
    """
    a, b = source - source.mean(axis=0), target - target.mean(axis=0)
    dot = (a * b).sum()
    cross = (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum()
    spread = max((a * a).sum(), 1e-300)
    scale, angle = math.hypot(dot, cross) / spread, math.atan2(cross, dot)
    rotation = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    return scale, angle, target.mean(axis=0) - scale * rotation @ source.mean(axis=0)


def moved_by_similarity(pose: Pose, scale: float, angle: float, shift: Vector2) -> Pose:
    """The pose after its canvas is transformed by a similarity; the frame's view does not change."""
    c, s = math.cos(angle), math.sin(angle)
    x = scale * (c * pose.x - s * pose.y) + float(shift[0])
    y = scale * (s * pose.x + c * pose.y) + float(shift[1])
    return Pose(x, y, pose.log_gsd + math.log(scale), pose.yaw + angle, pose.pitch, pose.roll)
