"""Renders the pictures: a lens over the world, with the defects of a real camera."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .canopy import Canopy
from .display import Display
from .geometry import (
    Array,
    CameraState,
    Lens,
    ground_of_rays,
    pixels_from_ground,
    rays_from_pixels,
    rays_of_picture,
    sinking_views,
)
from .glint import shimmer
from .ground.raster import Field
from .ground.woods import LOWEST_LEAVES
from .leaves import leaf_out
from .sensor import Sensor
from .sight import StillPlace, first_met
from .targets import Target, paint_targets
from .wind import still_place
from .world import World

HAZE = np.array([222, 208, 196], np.float32)  # BGR of the haze at the horizon
ZENITH = np.array([206, 160, 112], np.float32)  # BGR of the sky at the zenith
CLEAR_AIR = 4000.0  # metres over which 63 % of the light is lost to haze
SWAY = 0.4  # metres: standard deviation of the tops of the tallest trees
SHARPNESS = 0.3  # octaves of mip level bias: the mip filter alone is softer than a good lens


@dataclass(frozen=True, slots=True, kw_only=True)
class Camera:
    """Lens and sensor; the defaults model a decent small camera."""

    lens: Lens = field(default_factory=Lens)
    vignetting: float = 0.12  # share of light lost in the corners, quadratic in the radius
    exposure: float = 0.0  # standard deviation of the log exposure between frames
    exposure_step: float = 1.0  # factor by which auto exposure darkens every other run of frames
    step_every: int = 5  # frames per run
    noise: float = 1.5  # standard deviation of the sensor noise, in grey levels of 255
    quality: int = 92  # JPEG quality
    sensor: Sensor = field(default_factory=Sensor)
    display: Display | None = None  # what stands still in every picture

    def gain(self, index: int, rng: np.random.Generator) -> float:
        """Exposure factor of frame number `index`; 1 is nominal."""
        darker = index // self.step_every % 2 == 1
        return float(np.exp(rng.normal(0, self.exposure))) / (self.exposure_step if darker else 1.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Scene:
    """A camera over a world. relief: scale factor of the world's heights, 0 for a plane. sway: metres that wind moves the tops
    of the tallest trees (standard deviation), in a world where it moves any; places on crowns are those in still air. canopy:
    leaves over ground and targets; truth tells of the ground beneath.

    With relief, walls and crowns render correctly within about 40 degrees of nadir; more oblique views smear them. In a
    sheer world rays are traced to their first intersection, so tall objects occlude what is behind them.
    """

    world: World
    camera: Camera
    relief: float = 0.0
    sway: float = SWAY
    seed: int = 1
    targets: tuple[Target, ...] = ()
    canopy: Canopy | None = None

    def surface(self, x: Array, y: Array) -> Array:
        """Heights in metres at x, y (any shape)."""
        return self.world.height_at(x, y, self.relief)

    def ground_from_pixels(self, state: CameraState, pixels: Array) -> Array:
        """(n, 2) pixels -> (n, 2) metres: orthographic position of the surface point seen; NaN for sky."""
        x, y, _ = self.seen(state, rays_from_pixels(self.camera.lens, np.asarray(pixels, np.float64)))
        return np.stack([x, y], axis=-1)

    def seen(self, state: CameraState, rays: Array) -> tuple[Array, Array, Array]:
        """(x, y, height) in metres of the surface points seen along rays (..., 2); x, y are NaN for sky. Only in a sheer world
        has a place seen more than one height."""
        if self.relief and self.world.sheer:
            tallest = self.relief * float(self.world.heights.max())
            return first_met(state, rays, self.surface, tallest, *self.windy(state.time))
        x, y = ground_of_rays(state, rays, self.surface if self.relief else None)
        return x, y, self.surface(x, y) if self.relief else np.zeros_like(x)

    def windy(self, time: float) -> tuple[StillPlace, ...]:
        """What finds the place in still air of what the wind has moved; empty without wind."""
        if self.world.wind is None or not self.sway:
            return ()
        sway = self.world.wind.sway(time) * np.float32(self.sway)

        def still(x: Array, y: Array, height: Array) -> tuple[Array, Array]:
            column, row = (self.world.cell_of(np.atleast_2d(place), len(sway)) for place in (x, y))
            return still_place(sway, x, y, height, column, row)

        return (still,)

    def pixels_from_ground(self, state: CameraState, ground: Array) -> Array:
        """(n, 2) metres -> (n, 2) pixels of the surface there, occluded or not; NaN behind the camera."""
        heights = self.surface(ground[..., 0], ground[..., 1]) if self.relief else 0.0
        return pixels_from_ground(self.camera.lens, state, ground, heights)

    def picture(self, state: CameraState, index: int) -> NDArray[Any]:
        """(height, width, bands), BGR if three: the picture taken in this state; `index` seeds the frame's noise."""
        rng, light, display = self.chance(index), self.light(state), self.camera.display
        if display:
            light *= display.passed((light.shape[1], light.shape[0]))[..., None]
        counts = expose(self.camera, light, self.camera.gain(index, rng), rng)
        if display:
            white = self.camera.sensor.counts(np.full(counts.shape[-1], 255, np.float32))
            display.burn(counts, white, state, index)
        return counts

    def gain(self, index: int) -> float:
        """Exposure factor of a frame."""
        return self.camera.gain(index, self.chance(index))

    def chance(self, index: int) -> np.random.Generator:
        return np.random.default_rng([self.seed, 4, index])

    def light(self, state: CameraState) -> Field:
        """(height, width, 3): the light before the sensor."""
        rays = rays_of_picture(self.camera.lens)
        east, south, down = sinking_views(state, rays)
        x, y, height = self.seen(state, rays)
        covered = octave(self, state, down)
        colours = self.world.colours(x, y, covered)
        if self.world.wind is not None:
            leaf_out(colours, (x, y, height), LOWEST_LEAVES / 2, float(np.nanmedian(covered)))
        if self.world.water is not None:
            shimmer(colours, self.world.water_at(x, y), state, rays)
        paint_targets(colours, self.targets, state, self.pixels_from_ground)
        if self.canopy is not None:
            self.canopy.cover(colours, state, rays)
        horizon_near = down < 0.25 * np.sqrt(east * east + south * south)
        if horizon_near.any():
            veil(colours, state, (east, south, down))
        return colours

    def encoded(self, state: CameraState, index: int) -> bytes:
        """The picture in the sensor's file format."""
        return self.camera.sensor.encoded(self.picture(state, index), self.camera.quality)


def octave(scene: Scene, state: CameraState, down: Array) -> Array:
    """log2 of the world pixels covered by one picture pixel (geometric mean of both directions); NaN for sky.

    A plane seen along a ray with vertical component `down` (camera axes, z = 1) is scaled by height / focal * down^-1.5.
    """
    base = np.log2(state.height / scene.camera.lens.focal_px / scene.world.gsd) - SHARPNESS
    with np.errstate(invalid="ignore", divide="ignore"):
        steep = np.log2(np.where(down > 0, down, np.nan))
    return np.asarray(base - 1.5 * steep, np.float32)


def veil(colours: Field, state: CameraState, views: tuple[Array, Array, Array]) -> None:
    """Add haze to distant ground, and the sky above it, in place."""
    east, south, down = views
    slope = down / np.sqrt(east * east + south * south + down * down)
    distance = state.height / np.maximum(slope, 1e-5)
    haze = np.where(slope > 0, 1 - np.exp(-distance / CLEAR_AIR), 1.0)[..., None].astype(np.float32)
    up = np.clip(-slope * 2.5, 0, 1)[..., None].astype(np.float32)
    air = HAZE + (ZENITH - HAZE) * up
    colours += haze * (air - colours)


def expose(camera: Camera, light: Field, gain: float, rng: np.random.Generator) -> NDArray[Any]:
    """Apply vignetting, exposure and sensor noise; the counts of all bands."""
    radius2 = (rays_of_picture(camera.lens) ** 2).sum(-1)
    fall_off = 1 - np.float32(camera.vignetting) * radius2 / radius2.max()
    seen = camera.sensor.levels(light) * (np.float32(gain) * fall_off)[..., None]
    if camera.noise:
        seen += rng.standard_normal(seen.shape, np.float32) * np.float32(camera.noise)
    return camera.sensor.counts(seen)
