"""Pictures of simulated flights without and with people of known place, posture and clothes, in the sun, in the shade and under
leaves, sharp and smeared."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.detection.persons import CLOTHES, COLOURS, POSTURES, SIZES_M, Person
from sitl.camera import Scene, expose
from sitl.flight import Flight, plan
from sitl.geometry import CameraState, Lens, ground_from_pixels, pixels_from_ground, rays_of_picture
from sitl.ground.noise import fractal
from sitl.path import Plan
from sitl.targets import Target, paint_targets

SIZE = (560, 420)
PEOPLE = 90  # of each flight, at most
APART_M = 3.5
FRAMES = 6
SMEARS = (0, 0, 0, 0, 2, 4, 8)  # px of motion, drawn for each frame
SHADE, SHADED = 0.4, 0.9  # of the sun's light; deviations of noise above which there is shade
LEAVES_FROM = 1.0  # metres over the ground: what is higher hides who lies below
Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Setting:
    """A flight's ground, its seed, height (m), share of leaves, and whether things stand on it."""

    ground: str
    seed: int
    height: float
    leaves: float = 0.0
    relief: float = 0.0


@dataclass(frozen=True)
class Sought:
    """Someone on the ground."""

    target: Target
    person: Person


def crowd(flight: Flight, seed: int) -> list[Sought]:
    """People over the ground that the flight sees, of all postures and clothes."""
    rng, lens = np.random.default_rng([seed, 77]), flight.scene.camera.lens
    found: list[Sought] = []
    kinds = [(posture, clothes) for posture in POSTURES for clothes in CLOTHES]
    pixels = rng.uniform(0.05, 0.95, (400, 2)) * [lens.width, lens.height]
    spots = np.concatenate([ground_from_pixels(lens, state, pixels) for state in flight.states])
    for x, y in rng.permutation(spots).tolist():
        if len(found) == PEOPLE:
            break
        posture, clothes = kinds[len(found) % len(kinds)]
        length, width = SIZES_M[posture]
        heading = float(rng.uniform(0, 2 * np.pi))
        person = Person(posture=posture, clothes=clothes)
        target = Target(kind="person", x=x, y=y, length=length, width=width, heading=heading, colour=COLOURS[clothes])
        if all(abs(x - one.target.x) + abs(y - one.target.y) > APART_M for one in found):
            found.append(Sought(target, person))
    return found


def on_the_floor(lens: Lens, state: CameraState, ground: Floats) -> Floats:
    return np.asarray(pixels_from_ground(lens, state, ground), np.float64)


class Peopled:
    """Pictures of a flight without and with people."""

    def __init__(self, setting: Setting, cache: Path | None = None) -> None:
        self.flight = plan(
            "survey",
            SIZE,
            seed=setting.seed,
            ground=setting.ground,
            relief=setting.relief,
            leaves=setting.leaves,
            cache=cache,
            route=Plan(frames=FRAMES, height=setting.height, forward=0.7, side=0.55),
        )
        self.canopy = self.flight.scene.canopy
        self.scene: Scene = replace(self.flight.scene, canopy=None)
        self.people = crowd(self.flight, setting.seed)
        self.shade = fractal(np.random.default_rng([setting.seed, 78]), 512, coarsest=64, finest=16)
        self.smears = np.random.default_rng([setting.seed, 79]).choice(SMEARS, len(self.flight.states))

    def pictures(self, index: int) -> list[NDArray[np.uint8]]:
        """(without, with) of a frame."""
        state, lens = self.flight.states[index], self.scene.camera.lens
        rays = rays_of_picture(lens)
        empty = self.scene.light(state)
        peopled = empty.copy()
        targets = [one.target for one in self.people]
        paint_targets(
            peopled, targets, state, lambda at, ground: on_the_floor(lens, at, np.asarray(ground, np.float64))
        )
        x, y, height = self.scene.seen(state, rays)
        if self.scene.relief:
            above = height > LEAVES_FROM
            peopled[above] = empty[above]
        column, row = (np.asarray(place / 0.5 % 512, np.float32) for place in (x, y))
        shade = cv2.remap(self.shade, column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
        light = np.where(shade > SHADED, SHADE, 1).astype(np.float32)[..., None]
        found = []
        for one in (empty, peopled):
            one *= light
            if self.canopy is not None:
                self.canopy.cover(one, state, rays)
            if self.smears[index]:
                one = np.asarray(cv2.blur(one, (1, int(self.smears[index]) + 1)), np.float32)
            counts = expose(self.scene.camera, one, 1.0, self.scene.chance(index))
            data = cv2.imencode(".jpg", counts, [cv2.IMWRITE_JPEG_QUALITY, self.scene.camera.quality])[1]
            found.append(np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR), np.uint8))
        return found
