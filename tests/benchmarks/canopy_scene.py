"""The wood of `canopy`: a forest's floor beneath leaves, people on it, and a camera above.

The thermal camera shows KELVIN grey levels a kelvin (some 25 K over 255 levels, as gains that follow a forest's scene have it)
with 0.1 K of noise, a usual uncooled sensor's. Leaves and floor are as warm as their light is bright, by which crowns spread by
0.7 K behind the camera's optics and the floor by 0.6 K, as in shade and at night; in the sun crowns spread by more. People in
clothes are WARMER than the floor, as in cool air; bare skin would be by 15 K and more. These values are argued, not measured.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

import sitl.flight
from gcs_mosaic.integral.stack import GroundLook
from gcs_mosaic.stitch.arrays import FloatImage
from gcs_mosaic.stitch.camera.geometry import Camera, Pose
from sitl.geometry import CameraState, Lens, rays_of_picture, world_from_camera
from sitl.path import Plan
from sitl.sensor import LUMINANCE
from sitl.targets import CLOTHES, Target
from sitl.thermal import ThermalCamera
from sitl.world import World

SIZE = (320, 256)
HEIGHT = 50.0
FORWARD, SIDE = 0.9, 1 - 1 / 3
FRAMES = 210
APART = 20.0  # metres between people
LYING, SITTING = (1.7, 0.5), (0.6, 0.6)
EVEN = 1 / 3  # of the floor's contrast: it lies in the shade of the leaves
KELVIN, WARMER = 10.0, 8.0
THERMAL = ThermalCamera(writing=False, spots=0, rim=0.0, contrast=0.6)

Floats = NDArray[np.float64]


def planned(hidden: float, seed: int, kind: str) -> sitl.flight.Flight:
    """The flight, not yet rendered."""
    route = Plan(frames=FRAMES, height=HEIGHT, speed=8.0, forward=FORWARD, side=SIDE)
    flight = sitl.flight.plan("survey", SIZE, seed=seed, ground="floor", leaves=hidden, world_size=2048, route=route)
    world = flight.scene.world
    if kind == "thermal":
        middle = np.mean(world.levels[-1])
        levels = [np.clip(middle + EVEN * (one - middle) + 0.5, 0, 255).astype(np.uint8) for one in world.levels]
        world = replace(world, levels=tuple(levels))
    return replace(flight, scene=replace(flight.scene, world=world, targets=people(seed, kind, warm_light(world))))


def warm_light(world: World) -> float:
    """The light, the same in all bands, that the thermal camera shows WARMER than the floor's middle."""
    return float(np.mean(world.levels[-1].reshape(-1, 3) @ LUMINANCE[0])) + WARMER * KELVIN / THERMAL.contrast


def people(seed: int, kind: str, hot: float) -> tuple[Target, ...]:
    """Who lie and sit, one on each square of a grid over the hectare."""
    rng = np.random.default_rng([seed, 40])
    along = (np.arange(5) - 2) * APART
    found = []
    for number, (x, y) in enumerate((x, y) for x in along for y in along):
        length, width = LYING if number % 2 else SITTING
        at, heading = rng.uniform(-4, 4, 2) + np.array([x, y]), float(rng.uniform(0, 2 * np.pi))
        colour = (hot, hot, hot) if kind == "thermal" else CLOTHES[number % len(CLOTHES)]
        place = {"x": float(at[0]), "y": float(at[1]), "heading": heading}
        found.append(Target(kind="person", length=length, width=width, colour=colour, **place))
    return tuple(found)


@dataclass(frozen=True, slots=True)
class Model:
    """Means and variances of what frames show: leaves, the ground between them, and people in the open."""

    hidden: float
    leaves: tuple[float, float]
    ground: tuple[float, float]
    person: float

    def contrast(self, looks: int) -> float:
        """Of a person in the mean of independent looks: the ground's own texture is in focus and does not average out."""
        open_share = 1 - self.hidden
        apart = self.hidden * open_share * (self.leaves[0] - self.ground[0]) ** 2
        variance = open_share**2 * self.ground[1] + (apart + self.hidden * self.leaves[1]) / looks
        return open_share * abs(self.person - self.ground[0]) / math.sqrt(variance)


def model_of(flight: sitl.flight.Flight, images: Sequence[FloatImage]) -> Model:
    """Measured in some frames, by what is known to hide each pixel."""
    rays, canopy = rays_of_picture(flight.scene.camera.lens), flight.scene.canopy
    assert canopy is not None, "it is planned with leaves"
    shares = [(canopy.hides(flight.states[k], rays), images[k].mean(axis=2)) for k in range(0, len(images), 20)]
    hides, values = (np.concatenate([one[k].ravel() for one in shares]) for k in (0, 1))
    leaves, ground = values[hides > 0.9], values[hides < 0.1]
    bare = replace(flight.scene, canopy=None)
    person = np.mean([np.mean(one.colour) for one in flight.scene.targets])
    if images[0].shape[2] == 1:
        light = bare.light(flight.states[0]).mean()
        person = ground.mean() + THERMAL.contrast * (person - light)
    return Model(
        float(hides.mean()), (leaves.mean(), leaves.var()), (float(np.median(ground)), ground.var()), float(person)
    )


def pictures(flight: sitl.flight.Flight, kind: str) -> list[FloatImage]:
    """Grey levels (h, w, bands) of all frames."""
    found = list[FloatImage]()
    for index, state in enumerate(flight.states):
        if kind == "thermal":
            found.append(THERMAL.picture(cast(Any, flight.scene.light(state)), index)[..., None].astype(np.float32))
        else:
            found.append(flight.scene.picture(state, index).astype(np.float32))
    return found


def true_looks(flight: sitl.flight.Flight, images: Sequence[FloatImage]) -> tuple[list[GroundLook], Units, float]:
    """The looks where the cameras were, the metres of a canvas unit and so on, and the ground's height, canvas units."""
    lens = flight.scene.camera.lens
    gsd = HEIGHT / lens.focal_px
    camera = Camera(lens.width, lens.height, lens.focal, lens.k1)
    states = zip(flight.names, flight.states, images, strict=True)
    looks = [GroundLook(name, true_pose(state, lens, gsd), camera, image) for name, state, image in states]
    return looks, Units(np.array([[gsd, 0.0], [0.0, gsd]]), np.zeros(2)), 0.0


def true_pose(state: CameraState, lens: Lens, gsd: float) -> Pose:
    """On a canvas of `gsd` metres a unit."""
    r = world_from_camera(state)
    yaw, pitch, roll = math.atan2(r[1, 0], r[0, 0]), math.asin(-r[2, 0]), math.atan2(r[2, 1], r[2, 2])
    return Pose(state.x / gsd, state.y / gsd, math.log(state.height / gsd / lens.focal_px), yaw, pitch, roll)


@dataclass(frozen=True, slots=True)
class Units:
    """world = turn @ canvas + shift, metres."""

    turn: Floats
    shift: Floats

    @property
    def metres(self) -> float:
        return float(np.sqrt(abs(np.linalg.det(self.turn))))

    def world(self, x: float, y: float) -> Floats:
        return np.asarray(self.turn @ [x, y] + self.shift)

    def canvas(self, x: float, y: float) -> Floats:
        return np.asarray(np.linalg.solve(self.turn, np.array([x, y]) - self.shift))


def hidden_of(flight: sitl.flight.Flight, every: int = 3) -> list[float]:
    """Of each person: the share that leaves hide of him, over every so many of the frames that show his place."""
    rays, canopy, found = rays_of_picture(flight.scene.camera.lens), flight.scene.canopy, list[list[float]]()
    assert canopy is not None, "it is planned with leaves"
    found = [[] for _ in flight.scene.targets]
    for state in flight.states[::every]:
        hides = canopy.hides(state, rays)
        for one, shares in zip(flight.scene.targets, found, strict=True):
            x, y = flight.scene.pixels_from_ground(state, one.place(0.0)[None])[0]
            if 2 < x < SIZE[0] - 3 and 2 < y < SIZE[1] - 3:
                shares.append(float(hides[int(y) - 1 : int(y) + 2, int(x) - 1 : int(x) + 2].mean()))
    return [float(np.mean(shares)) if shares else 1.0 for shares in found]
