"""Vectorised camera over a plane with analytic derivatives, for many points of many frames at once.

Same model as `geometry`, in the units of the adjustment: pixels are centred and divided by the frame's half-diagonal, so that
one lens serves frames of any size. A pose is a row (x, y, log_gsd, yaw, pitch, roll), a lens a row (log focal, k1, k2, shift_x,
shift_y), which are its terms, and 1 for a fisheye, else 0 (or nothing, where none is).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from gcs_mosaic.stitch.arrays import (
    LensesNx5,
    LensRowsNx6,
    Mask,
    Matrices,
    PointsNx2,
    PosesNx6,
    RowsNx3,
    Vector,
)
from gcs_mosaic.stitch.camera.geometry import LEAST_SLOPE, Camera, Pose, lens_reach, undistorted_radius

LENS_TERMS = 5


@dataclass(frozen=True, slots=True)
class Projected:
    """Projected points (m, 2) and their derivatives; `valid` (m,) is False where a point cannot be projected."""

    points: PointsNx2
    by_point: Matrices  # (m, 2, 2)
    by_pose: Matrices  # (m, 2, 6)
    by_lens: Matrices  # (m, 2, 5)
    by_height: PointsNx2  # (m, 2), by height of the ground above the plane, canvas units
    valid: Mask


def pose_row(pose: Pose) -> tuple[float, ...]:
    return (pose.x, pose.y, pose.log_gsd, pose.yaw, pose.pitch, pose.roll)


def lens_terms(camera: Camera) -> tuple[float, ...]:
    return (math.log(camera.focal), camera.k1, camera.k2, camera.shift_x, camera.shift_y)


def lens_row(camera: Camera) -> tuple[float, ...]:
    return (*lens_terms(camera), float(camera.fisheye))


def lens_rows(terms: LensesNx5, fisheye: Mask) -> LensRowsNx6:
    """Rows (c, 6) of lenses with these terms (c, 5), and which of them are fisheyes, (c,)."""
    return np.column_stack([terms, fisheye])


def with_lens(camera: Camera, terms: ArrayLike) -> Camera:
    """The camera with a lens of these terms (5,), of the kind that it has."""
    log_focal, k1, k2, shift_x, shift_y = (float(value) for value in np.asarray(terms))
    return replace(camera, focal=math.exp(log_focal), k1=k1, k2=k2, shift_x=shift_x, shift_y=shift_y)


def rotations(poses: PosesNx6) -> tuple[Matrices, Matrices]:
    """Rotations canvas_from_camera (m, 3, 3) and the axes (m, 3, 3) about which yaw, pitch and roll rotate a canvas vector."""
    (cy, cp, cr), (sy, sp, sr) = np.cos(poses[:, 3:].T), np.sin(poses[:, 3:].T)
    zero, one = np.zeros_like(cy), np.ones_like(cy)
    rotation = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    axes = [[zero, zero, one], [-sy, cy, zero], [cy * cp, sy * cp, -sp]]
    return _many(rotation), _many(axes)


def _many(entries: list[list[Vector]]) -> Matrices:
    """Matrices (m, i, j) from entries (m,). The m are contiguous in memory: numpy is only fast along that axis."""
    return np.array(entries).transpose(2, 0, 1)


def _side_by_side(count: int, i: int, j: int) -> Matrices:
    """Zeros (count, i, j) with the memory layout of `_many`."""
    return np.zeros((i, j, count)).transpose(2, 0, 1)


def product(a: Matrices, b: Matrices) -> Matrices:
    """Products (m, i, k) of many small matrices (m, i, j) and (m, j, k), laid out as by `_many`."""
    found = _side_by_side(len(a), a.shape[1], b.shape[2])
    for j in range(a.shape[2]):
        found += a[:, :, j, None] * b[:, None, j]
    return found


def _turned(by_ray: Matrices, ray: RowsNx3, axes: Matrices) -> Matrices:
    """Derivative (m, 2, 3) by rotations about three axes (m, 3, 3), given the derivative by the ray (m, 3), by_ray (m, 2, 3).

    A rotation moves the ray by axis x ray, and by . (axis x ray) = axis . (ray x by).
    """
    x, y, z = ray.T
    moments = [[y * bz - z * by, z * bx - x * bz, x * by - y * bx] for bx, by, bz in by_ray.transpose(1, 2, 0)]
    return product(_many(moments), axes.transpose(0, 2, 1))


def canvas_from_pixels(poses: PosesNx6, lenses: LensRowsNx6, half_diagonals: Vector, pixels: PointsNx2) -> Projected:
    """Canvas places of pixels (m, 2), with one pose, lens and half-diagonal (m,) each."""
    poses, lenses, pixels = (np.asfortranarray(values) for values in (poses, lenses, pixels))
    rotation, axes = rotations(poses)
    u, u_by_pixel, u_by_lens, seen = _undistorted(pixels, lenses)
    ray = product(rotation[:, :, :2], u[:, :, None])[:, :, 0] + rotation[:, :, 2]
    depth = np.where(abs(ray[:, 2]) < 1e-6, 1e-6, ray[:, 2])
    height = np.exp(poses[:, 2] + lenses[:, 0]) * half_diagonals
    offset = height[:, None] * ray[:, :2] / depth[:, None]
    by_ray = _perspective_derivative(ray[:, :2], depth) * height[:, None, None]
    by_u = product(by_ray, rotation[:, :, :2])
    by_pose = _side_by_side(len(pixels), 2, 6)
    by_pose[:, 0, 0] = by_pose[:, 1, 1] = 1
    by_pose[:, :, 2] = offset
    by_pose[:, :, 3:] = _turned(by_ray, ray, axes)
    by_lens = product(by_u, u_by_lens)
    by_lens[:, :, 0] += offset
    by_height = -ray[:, :2] / depth[:, None]
    visible = seen & (ray[:, 2] > 0.02)
    return Projected(poses[:, :2] + offset, product(by_u, u_by_pixel), by_pose, by_lens, by_height, visible)


def pixels_from_canvas(
    poses: PosesNx6, lenses: LensRowsNx6, half_diagonals: Vector, places: PointsNx2, heights: Vector | float = 0.0
) -> Projected:
    """Pixels (m, 2) of canvas places (m, 2) at these heights (m,) above the plane, with one pose, lens and half-diagonal (m,)
    each."""
    poses, lenses, places = (np.asfortranarray(values) for values in (poses, lenses, places))
    rotation, axes = rotations(poses)
    height = np.exp(poses[:, 2] + lenses[:, 0]) * half_diagonals
    sight = np.array([places[:, 0] - poses[:, 0], places[:, 1] - poses[:, 1], height - heights]).T
    ray = product(rotation.transpose(0, 2, 1), sight[:, :, None])[:, :, 0]
    depth = np.where(abs(ray[:, 2]) < 1e-6, 1e-6, ray[:, 2])
    u = ray[:, :2] / depth[:, None]
    bent, bent_by_u = _bent(u, lenses)
    v, v_by_bent, v_by_k = _distorted(bent, lenses)
    v_by_u = v_by_bent if bent_by_u is None else product(v_by_bent, bent_by_u)
    focal = np.exp(lenses[:, 0])
    by_ray = product(v_by_u, _perspective_derivative(ray[:, :2], depth)) * focal[:, None, None]
    by_sight = product(by_ray, rotation.transpose(0, 2, 1))
    by_pose = _side_by_side(len(places), 2, 6)
    by_pose[:, :, :2] = -by_sight[:, :, :2]
    by_pose[:, :, 2] = by_sight[:, :, 2] * height[:, None]
    by_pose[:, :, 3:] = -_turned(by_sight, sight, axes)
    points = focal[:, None] * v
    by_lens = _side_by_side(len(places), 2, LENS_TERMS)
    by_lens[:, :, 0] = by_pose[:, :, 2] + points
    by_lens[:, :, 1:3] = focal[:, None, None] * v_by_k
    by_lens[:, :, 3:] = np.eye(2)
    within = bent[:, 0] ** 2 + bent[:, 1] ** 2 < lens_reach(lenses[:, 1], lenses[:, 2]) ** 2
    valid = (ray[:, 2] > 0.02 * height) & within
    return Projected(points + lenses[:, 3:5], by_sight[:, :, :2], by_pose, by_lens, -by_sight[:, :, 2], valid)


def _perspective_derivative(xy: PointsNx2, depth: Vector) -> Matrices:
    """Derivative (m, 2, 3) of (x / z, y / z) by (x, y, z)."""
    by = _side_by_side(len(xy), 2, 3)
    by[:, 0, 0] = by[:, 1, 1] = 1 / depth
    by[:, :, 2] = -xy / depth[:, None] ** 2
    return by


def _bent(u: PointsNx2, lenses: LensRowsNx6) -> tuple[PointsNx2, Matrices | None]:
    """Rays u (m, 2) as long as the angle to the axis is, of fisheyes, and the derivative (m, 2, 2); None if all are as they
    were."""
    if not lenses[:, LENS_TERMS:].any():
        return u, None
    r = np.maximum(np.hypot(u[:, 0], u[:, 1]), NO_RADIUS)
    factor = np.arctan(r) / r
    return _scaled(u, lenses, factor, (1 / (1 + r**2) - factor) / r**2)


def _straightened(bent: PointsNx2, lenses: LensRowsNx6) -> tuple[PointsNx2, Matrices | None]:
    """The inverse of `_bent`."""
    if not lenses[:, LENS_TERMS:].any():
        return bent, None
    r = np.clip(np.hypot(bent[:, 0], bent[:, 1]), NO_RADIUS, WIDEST)
    factor = np.tan(r) / r
    return _scaled(bent, lenses, factor, (1 + np.tan(r) ** 2 - factor) / r**2)


def _scaled(rays: PointsNx2, lenses: LensRowsNx6, factor: Vector, slope: Vector) -> tuple[PointsNx2, Matrices]:
    """Rays (m, 2) times a factor (m,) where the lens is a fisheye, and the derivative (m, 2, 2); `slope`: of the factor by the
    radius, over the radius."""
    fisheye = lenses[:, LENS_TERMS] > 0
    factor, slope = np.where(fisheye, factor, 1.0), np.where(fisheye, slope, 0.0)
    x, y = rays.T
    by_rays = _many([[factor + slope * x * x, slope * x * y], [slope * x * y, factor + slope * y * y]])
    return rays * factor[:, None], by_rays


NO_RADIUS = 1e-6  # focal lengths; nearer to the axis rays count as this far from it
WIDEST = 1.55  # radians, 89 degrees: what a fisheye sees farther out meets no ground


def _distorted(u: PointsNx2, lenses: LensRowsNx6) -> tuple[PointsNx2, Matrices, Matrices]:
    """Distortion of u (m, 2): the result, its derivative by u (m, 2, 2) and by k1 and k2 (m, 2, 2)."""
    k1, k2 = lenses[:, 1], lenses[:, 2]
    r2 = u[:, 0] ** 2 + u[:, 1] ** 2
    factor, slope = 1 + r2 * (k1 + r2 * k2), 2 * k1 + 4 * k2 * r2
    x, y = u.T
    by_u = _many([[factor + slope * x * x, slope * x * y], [slope * x * y, factor + slope * y * y]])
    return u * factor[:, None], by_u, _many([[x * r2, x * r2**2], [y * r2, y * r2**2]])


def _inverse(a: Matrices) -> Matrices:
    """Inverses of matrices (m, 2, 2); huge for singular ones."""
    (a00, a01), (a10, a11) = a.transpose(1, 2, 0)
    determinant = a00 * a11 - a01 * a10
    one_by = 1 / np.where(abs(determinant) < 1e-24, 1e-24, determinant)
    return _many([[a11 * one_by, -a01 * one_by], [-a10 * one_by, a00 * one_by]])


def _undistorted(pixels: PointsNx2, lenses: LensRowsNx6) -> tuple[PointsNx2, Matrices, Matrices, Mask]:
    """Inverse distortion: u (m, 2), its derivatives by the pixel (m, 2, 2) and by the lens (m, 2, 5), and where it exists
    (m,)."""
    focal, k1, k2 = np.exp(lenses[:, 0]), lenses[:, 1], lenses[:, 2]
    distorted = (pixels - lenses[:, 3:5]) / focal[:, None]
    r_distorted = np.hypot(distorted[:, 0], distorted[:, 1])
    r, reached = undistorted_radius(r_distorted, k1, k2, lens_reach(k1, k2))
    u = distorted * np.where(r_distorted > 1e-12, r / np.maximum(r_distorted, 1e-12), 1.0)[:, None]
    _, distorted_by_u, distorted_by_k = _distorted(u, lenses)
    u_by_distorted = _inverse(distorted_by_u)
    u_by_pixel = u_by_distorted / focal[:, None, None]
    by_lens = _side_by_side(len(pixels), 2, LENS_TERMS)
    by_lens[:, :, :1] = -product(u_by_distorted, distorted[:, :, None])
    by_lens[:, :, 1:3] = -product(u_by_distorted, distorted_by_k)
    by_lens[:, :, 3:] = -u_by_pixel
    exists = reached & (1 + r**2 * (3 * k1 + 5 * k2 * r**2) > LEAST_SLOPE)
    straight, by_u = _straightened(u, lenses)
    if by_u is not None:
        exists &= (lenses[:, LENS_TERMS] == 0) | (r < WIDEST)
        u, u_by_pixel, by_lens = straight, product(by_u, u_by_pixel), product(by_u, by_lens)
    return u, u_by_pixel, by_lens, exists
