"""A frame on the tiles of its level: exact places on a coarse lattice shared by all tiles.

The camera model is evaluated at every 16th tile pixel and interpolated between (`warp.upscale`). The second derivative of a
tilted, distorted view is about 4e-4 / px for a 12 MP frame, giving an error of some 0.02 px there, 0.1 px for 0.75 MP. There is
one lattice per frame and level, so a tile's content does not depend on which tiles are requested.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from gcs_mosaic.render.tile_grid import (
    RESOLUTION_LOSS,
    TILE_SIZE,
    Box,
    Tile,
    box_of,
    canvas_from_level,
    pixel_size,
    tile_range,
)
from gcs_mosaic.stitch.arrays import Lattice, Mask
from gcs_mosaic.stitch.camera.dead_border import NO_BORDER, DeadBorder
from gcs_mosaic.stitch.camera.geometry import (
    Camera,
    Pose,
    canvas_from_pixels,
    frame_border,
    ground_sampling_distance,
    pixel_grid,
    pixels_from_canvas,
)
from gcs_mosaic.stitch.camera.picture_area import PictureArea
from gcs_mosaic.stitch.camera.relief import ReliefDisplacement, as_seen, on_plane
from gcs_mosaic.stitch.camera.still_mask import StillMask

LATTICE_STEP = 16  # tile px
LATTICE = TILE_SIZE // LATTICE_STEP + 1  # lattice points along a tile's side; neighbours share those on their edge
USEFUL_RATIO = 4.0  # maximum ground sampling distance relative to the frame's best (oblique frames)
RIM = 1.5  # lattice steps inside a frame's border where its weight reaches 0, so that interpolated weights have no step
OBLIQUE_SHARE = 0.8  # a frame's level resolves this much of its root mean square ground sampling distance, and no finer
ROUGH_STEPS = 3  # of the iteration that finds the initial guess for relief
# Length of a step of the exact iteration after which a point is done. A quarter of it is left at most, which is less than
# interpolation between lattice points errs by.
LATTICE_CONVERGED_PX = 0.03
MOST_TILES_PER_PIXEL = 20 / TILE_SIZE**2  # far above what any plausible pose needs at its own level


@dataclass(frozen=True, slots=True, eq=False)
class FrameLattice:
    """A frame on the tile grid of one level.

    `pixels` (rows * 16 + 1, columns * 16 + 1, 2): frame pixels at the lattice points, NaN where nowhere. `weight` (same, no
    last axis): 0 at the border of the live area and outside, 1 in its centre if the frame resolves the ground as finely as the
    level does, less by the square if not; 0 under an overlay. `useful`: above 0 where the resolution suffices, or None if
    everywhere. `covered`: 1 under an overlay, 0 elsewhere; None without one.
    """

    first: Tile
    last: Tile
    camera: Camera
    pixels: Lattice
    weight: Lattice
    useful: Lattice | None
    dead: DeadBorder = NO_BORDER
    covered: Lattice | None = None

    @property
    def limits(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Minimum and maximum (x, y) of the painted area of the frame."""
        return self.dead.limits(self.camera.width, self.camera.height)

    def window(self, tile: Tile) -> tuple[slice, slice]:
        """Rows and columns of a tile's lattice points."""
        y, x = ((i - first) * (LATTICE - 1) for i, first in ((tile.y, self.first.y), (tile.x, self.first.x)))
        return slice(y, y + LATTICE), slice(x, x + LATTICE)

    def inside(self) -> Mask:
        """Which lattice points lie within the painted area of the frame."""
        (left, top), (right, bottom) = self.limits
        x, y = self.pixels[..., 0], self.pixels[..., 1]
        within = (x > left) & (x < right) & (y > top) & (y < bottom)
        return np.asarray(within if self.useful is None else within & (self.useful > 0))

    def tiles(self) -> Iterator[Tile]:
        """The tiles that this frame touches, row by row; a few of them may turn out to be empty."""
        near = cv2.dilate(self.inside().astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
        for y in range(self.first.y, self.last.y + 1):
            for x in range(self.first.x, self.last.x + 1):
                tile = Tile(self.first.z, x, y)
                if near[self.window(tile)].any():
                    yield tile


def frame_lattice(
    pose: Pose,
    camera: Camera,
    level: int,
    relief: ReliefDisplacement | None = None,
    dead: DeadBorder = NO_BORDER,
    still: StillMask | None = None,
    area: PictureArea | None = None,
) -> FrameLattice | None:
    """The lattice of a frame at a level; None where it sees no ground. ValueError if the level is absurdly fine for it."""
    ground = useful_ground(pose, camera, relief)
    if ground is None:
        return None
    box, best = ground
    first, last = tile_range(box, level)
    _check_cost(camera, level, (last.x - first.x + 1) * (last.y - first.y + 1))
    pixels = _lattice_pixels(pose, camera, relief, first, last)
    detail = _frame_pixels_per_step(pixels) / LATTICE_STEP
    depth = None if area is None else _depth(pixels, camera, area)
    weight = _border_weight(pixels, camera, dead, RIM * LATTICE_STEP * pixel_size(level) / best, depth)
    weight *= np.minimum(detail * (1 - RESOLUTION_LOSS), 1) ** 2
    useful = np.log(np.maximum(detail * USEFUL_RATIO * best / pixel_size(level), 0.1))
    if depth is not None:  # in its own unit, so that zero lies between lattice points where the picture's edge does
        useful = np.minimum(useful * np.float32(camera.width), depth)
    covered = None if still is None else _covered(pixels, camera, still)
    if covered is not None:
        weight *= 1 - covered
    return FrameLattice(first, last, camera, pixels, weight, useful if useful.min() <= 0 else None, dead, covered)


def resolved(pose: Pose, camera: Camera) -> float | None:
    """The ground sampling distance a frame is painted at: all but its finest tenth keep their resolution, unless that would take
    more than about four times the frame's own pixels (oblique frames); None if it sees no ground."""
    gsd = ground_sampling_distance(pose, camera, pixel_grid(camera, 33, 25))
    gsd = gsd[np.isfinite(gsd) & (gsd > 0)]
    if not gsd.size:
        return None
    useful = gsd[gsd <= USEFUL_RATIO * gsd.min()]
    return max(float(np.quantile(useful, 0.1)), OBLIQUE_SHARE * float(np.sqrt((useful**2).mean())))


def useful_ground(pose: Pose, camera: Camera, relief: ReliefDisplacement | None = None) -> tuple[Box, float] | None:
    """Canvas box of the ground that a frame resolves well enough to be painted (slightly too large for oblique frames), and the
    frame's best ground sampling distance; None if it sees no ground."""
    pixels = np.vstack([frame_border(camera, 64), pixel_grid(camera, 65, 49)])
    places = canvas_from_pixels(pose, camera, on_plane(relief, camera, pixels))
    gsd = ground_sampling_distance(pose, camera, pixels)
    seen = np.isfinite(places).all(axis=1) & np.isfinite(gsd) & (gsd > 0)
    if not seen.any():
        return None
    best = float(gsd[seen].min())
    useful = seen & (gsd <= USEFUL_RATIO * best)
    cell = max(camera.width / 64, camera.height / 48)
    margin = best if useful.all() else 2 * USEFUL_RATIO * best * cell
    box = box_of(places[useful])
    return None if box is None else ((box[0] - margin, box[1] - margin, box[2] + margin, box[3] + margin), best)


def _check_cost(camera: Camera, level: int, tiles: int) -> None:
    if tiles > 64 + MOST_TILES_PER_PIXEL * camera.width * camera.height:
        raise ValueError(f"a frame of {camera.width} x {camera.height} px would take {tiles} tiles at level {level}")


def _lattice_pixels(pose: Pose, camera: Camera, relief: ReliefDisplacement | None, first: Tile, last: Tile) -> Lattice:
    x, y = (
        canvas_from_level(first.z, np.arange(a * TILE_SIZE, (b + 1) * TILE_SIZE + 1, LATTICE_STEP, dtype=np.float64))
        for a, b in ((first.x, last.x), (first.y, last.y))
    )
    planar = pixels_from_canvas(pose, camera, np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2))
    planar = planar.reshape(len(y), len(x), 2)
    if relief is None:
        return planar.astype(np.float32)
    guess = planar + _rough_shifts(relief, camera, planar.astype(np.float32))
    seen = as_seen(relief, camera, planar.reshape(-1, 2), guess.reshape(-1, 2), LATTICE_CONVERGED_PX)
    return seen.reshape(planar.shape).astype(np.float32)


def _rough_shifts(relief: ReliefDisplacement, camera: Camera, planar: Lattice) -> Lattice:
    """What relief adds to pixels (h, w, 2) on the plane, to a fraction of a pixel: OpenCV rounds places in the grid to its 1/32,
    in a fiftieth of the time of an exact step."""
    cells = [(n - 1) / max(size - 1, 1) for n, size in ((relief.columns, camera.width), (relief.rows, camera.height))]
    grid = relief.grid * (-camera.half_diagonal * np.array(cells, np.float32))
    places = times_each(planar, cells)
    np.copyto(places, np.float32(0), where=np.isnan(places))
    there = places
    for _ in range(ROUGH_STEPS):
        there = places + cv2.remap(grid, there, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)  # type: ignore
    return times_each(there - places, [1 / each for each in cells])


def times_each(values: Lattice, factors: Sequence[float]) -> Lattice:
    """Values (h, w, k), the last two axes together in memory, times a factor (k,) each: in rows, because numpy takes ten times as
    long along a short axis."""
    height, width, _ = values.shape
    rows = values.reshape(height, -1) * np.tile(np.array(factors, np.float32), width)
    return np.asarray(rows.reshape(values.shape), np.float32)


def _border_weight(
    pixels: Lattice, camera: Camera, dead: DeadBorder, rim: float, depth: Lattice | None = None
) -> Lattice:
    """Distance to the nearest border of the live area, 0 up to `rim` px inside it, normalised to a maximum of 1. `depth`: the
    same to what holds no picture, px."""
    x, y, width, height = pixels[..., 0] + 0.5, pixels[..., 1] + 0.5, camera.width, camera.height
    from_sides = np.minimum(x - dead.left, width - dead.right - x), np.minimum(y - dead.top, height - dead.bottom - y)
    nearest = np.minimum(*from_sides)
    distance = (nearest if depth is None else np.minimum(nearest, depth)) - rim
    most = max(min(width - dead.left - dead.right, height - dead.top - dead.bottom) / 2 - rim, 1.0)
    return np.asarray(np.clip(np.nan_to_num(distance, nan=0.0) / most, 0, 1), dtype=np.float32)


def _depth(pixels: Lattice, camera: Camera, area: PictureArea) -> Lattice:
    """How far the lattice points are from what holds no picture, in frame px; negative within it."""
    return area.depth(pixels.reshape(-1, 2), camera.width, camera.height).reshape(pixels.shape[:2])


def _covered(pixels: Lattice, camera: Camera, still: StillMask) -> Lattice:
    """1 at the lattice points that an overlay covers, 0 at the others."""
    places = np.nan_to_num(pixels.reshape(-1, 2), nan=-1.0)
    x, y = places.T
    within = (x >= -0.5) & (x < camera.width - 0.5) & (y >= -0.5) & (y < camera.height - 0.5)
    covered = within & still.covers(places, camera.width, camera.height)
    return np.asarray(covered.reshape(pixels.shape[:2]), np.float32)


def _frame_pixels_per_step(pixels: Lattice) -> Lattice:
    """Frame pixels per lattice step, as the square root of an area; 0 where nowhere."""
    along_y, along_x = (np.gradient(pixels, axis=axis) for axis in (0, 1))
    area = along_x[..., 0] * along_y[..., 1] - along_x[..., 1] * along_y[..., 0]
    return np.asarray(np.nan_to_num(np.sqrt(np.abs(area)), nan=0.0), dtype=np.float32)
