"""Camera model: projection from pixels to the ground and back.

Ground coordinates are metres: x east, y SOUTH, height up. With z = -height this is right-handed, and a level camera
heading north has exactly these axes (x right, y down in the picture, z along the view), so its rotation is the identity.
Pixels follow OpenCV: the centre of the top-left pixel is (0, 0).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating[Any]]
HeightAt = Callable[[Array, Array], Array]

NEWTON_STEPS = 6  # the radial term is mild: leaves an error below a thousandth of a pixel
SURFACE_STEPS = 6  # fixed-point iterations; converges on slopes gentler than the ray
LOWEST_VIEW = 1e-4  # least downward slope of a ray that counts as hitting the ground


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraState:
    """Pose of the camera at the time of a picture.

    time: seconds since the start of the flight; x, y, height: metres; yaw: heading of the picture's top, clockwise from
    north; pitch: nose up, which tilts the view towards the heading; roll: right wing down. Angles in radians.
    """

    time: float
    x: float
    y: float
    height: float
    yaw: float = 0.0
    pitch: float = 0.0
    roll: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Lens:
    """A pinhole camera with one radial distortion term.

    focal: in half-diagonals of the picture; k1: OpenCV's sense, distorted = undistorted * (1 + k1 r^2), r in focal lengths.
    """

    width: int = 1200
    height: int = 900
    focal: float = 1.45  # a common small camera: 69 degrees diagonal field of view
    k1: float = -0.04  # 2 % barrel distortion in the corners, as on small drones

    @property
    def focal_px(self) -> float:
        return self.focal * 0.5 * float(np.hypot(self.width, self.height))

    @property
    def centre(self) -> tuple[float, float]:
        return (self.width - 1) / 2, (self.height - 1) / 2

    def footprint(self, height: float) -> tuple[float, float]:
        """Footprint of a level picture in metres, across and along the heading, without distortion."""
        return self.width * height / self.focal_px, self.height * height / self.focal_px


def world_from_camera(state: CameraState) -> NDArray[np.float64]:
    """3x3 rotation matrix: roll, then pitch, then yaw."""
    (cy, cp, cr), (sy, sp, sr) = (
        np.cos([state.yaw, state.pitch, state.roll]),
        np.sin([state.yaw, state.pitch, state.roll]),
    )
    turn = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    nod = np.array([[1, 0, 0], [0, cp, -sp], [0, sp, cp]])
    bank = np.array([[cr, 0, -sr], [0, 1, 0], [sr, 0, cr]])
    return np.asarray(turn @ nod @ bank, np.float64)


def undistort(distorted: Array, k1: float) -> Array:
    """Solve r (1 + k1 r^2) = r_d for points (n, 2) in focal lengths, by Newton's method."""
    radius_d = np.hypot(distorted[..., 0], distorted[..., 1])
    radius = radius_d.copy()
    for _ in range(NEWTON_STEPS):
        radius = radius - (radius * (1 + k1 * radius**2) - radius_d) / (1 + 3 * k1 * radius**2)
    factor = np.divide(radius, radius_d, out=np.ones_like(radius), where=radius_d > 0)
    return np.asarray(distorted * factor[..., None])


def rays_from_pixels(lens: Lens, pixels: Array) -> Array:
    """(..., 2) pixels -> (..., 2) undistorted directions with z = 1 in camera axes."""
    return undistort((pixels - np.array(lens.centre)) / lens.focal_px, lens.k1)


@lru_cache(maxsize=4)
def rays_of_picture(lens: Lens) -> NDArray[np.float32]:
    """(height, width, 2) directions of all pixels; equal for all frames of a camera."""
    x, y = np.meshgrid(np.arange(lens.width, dtype=np.float64), np.arange(lens.height, dtype=np.float64))
    return rays_from_pixels(lens, np.stack([x, y], axis=-1)).astype(np.float32)


def sinking_views(state: CameraState, rays: Array) -> tuple[Array, Array, Array]:
    """Directions (east, south, down) of rays (..., 2), as three arrays; down <= LOWEST_VIEW is sky."""
    rotation = world_from_camera(state).astype(rays.dtype)
    east, south, down = (rays[..., 0] * row[0] + rays[..., 1] * row[1] + row[2] for row in rotation)
    return east, south, down


def ground_of_rays(state: CameraState, rays: Array, height_at: HeightAt | None = None) -> tuple[Array, Array]:
    """(x, y) in metres of the surface seen along rays (..., 2); NaN for sky.

    The surface is z = 0, or the given heights, found by fixed-point iteration along each ray.
    """
    east, south, down = sinking_views(state, rays)
    per_metre = np.divide(1, down, out=np.full_like(down, np.nan), where=down > LOWEST_VIEW)
    east, south = east * per_metre, south * per_metre
    drop: Array | float = state.height
    if height_at is not None:
        for _ in range(SURFACE_STEPS):
            drop = state.height - height_at(state.x + east * drop, state.y + south * drop)
    return state.x + east * drop, state.y + south * drop


def ground_from_pixels(lens: Lens, state: CameraState, pixels: Array, height_at: HeightAt | None = None) -> Array:
    """(n, 2) pixels -> (n, 2) ground points; NaN for sky. With relief: orthographic position of the surface seen."""
    x, y = ground_of_rays(state, rays_from_pixels(lens, np.asarray(pixels, np.float64)), height_at)
    return np.stack([x, y], axis=-1)


def pixels_from_ground(lens: Lens, state: CameraState, ground: Array, heights: Array | float = 0.0) -> Array:
    """(n, 2) ground points at heights (n,) -> (n, 2) pixels, also outside the picture; NaN behind the camera."""
    ground = np.asarray(ground, np.float64)
    down = state.height - np.broadcast_to(np.asarray(heights, np.float64), ground.shape[:-1])
    offset = np.stack([ground[..., 0] - state.x, ground[..., 1] - state.y, down], axis=-1)
    seen = offset @ world_from_camera(state)
    depth = np.where(seen[..., 2] > 1e-9, seen[..., 2], np.nan)
    ideal = seen[..., :2] / depth[..., None]
    radius2 = (ideal**2).sum(-1, keepdims=True)
    folded = 1 + 3 * lens.k1 * radius2 <= 0
    bent = np.where(folded, np.nan, ideal * (1 + lens.k1 * radius2))
    return np.asarray(bent * lens.focal_px + np.array(lens.centre))


def resolution(lens: Lens, state: CameraState, pixels: Array) -> Array:
    """Metres per pixel on the plane z = 0 at pixels (n, 2), in the coarsest direction; NaN for sky."""
    half = np.array([[0.5, 0.0], [0.0, 0.5]])
    columns = [
        ground_from_pixels(lens, state, pixels + step) - ground_from_pixels(lens, state, pixels - step) for step in half
    ]
    jacobian = np.stack(columns, axis=-1)
    coarsest = np.full(len(jacobian), np.nan)
    finite = np.isfinite(jacobian).all((1, 2))
    coarsest[finite] = np.linalg.svd(jacobian[finite], compute_uv=False)[:, 0]
    return coarsest
