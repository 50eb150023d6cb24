"""Thermal flights over a wood as a camera leaves them: files in a folder, with the defects of uncooled cameras.

Low over crowns that reach half way to the aircraft, as the flights of airborne optical sectioning are flown: 640x512 pixels of 43
degrees at 30 to 40 m, frames one to a few metres apart on lines. The scene's warmth is that of `canopy_scene`; the camera adds
noise of 0.1 K, columns and rows of 0.1 K, corners that are colder by 1 K, and tells 16-bit counts of 0.04 K, or 8 bits whose
gain follows each frame.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

import cv2
import numpy as np
import tifffile
from numpy.typing import NDArray

import sitl.flight
from sitl.camera import Camera
from sitl.canopy import Canopy
from sitl.conifers import Conifers
from sitl.geometry import Lens
from sitl.path import Plan
from sitl.sensor import LUMINANCE
from sitl.targets import CLOTHES, Target
from sitl.thermal import ThermalCamera
from sitl.world import World
from tests.benchmarks.canopy_scene import EVEN, KELVIN, LYING, SITTING, THERMAL, warm_light

SIZE = (640, 512)
FOCAL = 0.5 * SIZE[0] / np.tan(np.radians(21.5)) / (0.5 * np.hypot(*SIZE))  # half diagonals: 43 degrees across
LOWEST, HIGHEST = 3.0, 17.0  # metres of leaves
APART = 6.0  # metres between people
COUNT = 0.04  # kelvin
OFFSET = 29_000
AGC = (0.005, 0.995)  # shares of pixels that automatic gain lays on black and white
SENSOR = ThermalCamera(writing=False, spots=0, rim=-10.0, grid=1.0, noise=1.0, contrast=THERMAL.contrast)
WORLD = 1024  # texels of 0.1 m


@dataclass(frozen=True, slots=True, kw_only=True)
class Wood:
    """A flight to be made. trees: conifers, or leaves at all heights alike; kind: agc, counts, palette or colour; route: grid
    (lines 4 m apart), line or circle."""

    trees: str = "conifers"
    hidden: float = 0.7
    seed: int = 1
    kind: str = "agc"
    route: str = "grid"
    height: float = 35.0
    frames: int = 36
    step: float = 2.0  # metres between frames
    lines: float = 4.0  # metres between lines


def planned(wood: Wood) -> sitl.flight.Flight:
    """The flight, not yet rendered, with people on a grid beneath its middle."""
    lens = Lens(width=SIZE[0], height=SIZE[1], focal=float(FOCAL))
    across, along = lens.footprint(wood.height)
    scenario = {"grid": "survey", "line": "survey", "circle": "circle"}[wood.route]
    side = 1 - wood.lines / across if wood.route == "grid" else 0.0
    frames = wood.frames
    if wood.route == "line":
        side = -frames  # so far apart that there is one line
    route = Plan(frames=frames, height=wood.height, speed=4.0, wind=0.2, forward=1 - wood.step / along, side=side)
    suffix = ".JPG"
    flight = sitl.flight.plan(
        scenario, SIZE, seed=wood.seed, ground="floor", world_size=WORLD, route=route, camera=Camera(lens=lens)
    )
    names = tuple(str(Path(one).with_suffix(suffix if wood.kind != "counts" else ".TIF")) for one in flight.names)
    world = flight.scene.world
    if wood.kind != "colour":
        middle = np.mean(world.levels[-1])
        levels = [np.clip(middle + EVEN * (one - middle) + 0.5, 0, 255).astype(np.uint8) for one in world.levels]
        world = replace(world, levels=tuple(levels))
    kind = Conifers if wood.trees == "conifers" else Canopy
    canopy = kind(wood.hidden, lowest=LOWEST, highest=HIGHEST, seed=wood.seed)
    scene = replace(flight.scene, world=world, canopy=canopy, targets=people(flight, wood, world))
    return replace(flight, scene=scene, names=names)


def people(flight: sitl.flight.Flight, wood: Wood, world: World) -> tuple[Target, ...]:
    """Who lie and sit where frames are above."""
    rng, hot = np.random.default_rng([wood.seed, 41]), warm_light(world)
    nadirs = np.array([[one.x, one.y] for one in flight.states])
    low, high = nadirs.min(axis=0) - 4, nadirs.max(axis=0) + 4
    counts = np.maximum(((high - low) / APART).round().astype(int), 1)
    found = list[Target]()
    for row in range(counts[1]):
        for column in range(counts[0]):
            middle = low + (np.array([column, row]) + 0.5) * (high - low) / counts
            at, heading = middle + rng.uniform(-1.5, 1.5, 2), float(rng.uniform(0, 2 * np.pi))
            length, width = LYING if len(found) % 2 else SITTING
            colour = (hot, hot, hot) if wood.kind != "colour" else CLOTHES[len(found) % len(CLOTHES)]
            place = {"x": float(at[0]), "y": float(at[1]), "heading": heading}
            found.append(Target(kind="person", length=length, width=width, colour=colour, **place))
    return tuple(found)


def written(flight: sitl.flight.Flight, wood: Wood, folder: Path) -> list[Path]:
    """The files, in order."""
    paths = list[Path]()
    for name, data in zip(flight.names, encoded(flight, wood), strict=True):
        path = folder / Path(name).name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data) if isinstance(data, bytes) else tifffile.imwrite(path, data, photometric="minisblack")
        paths.append(path)
    return paths


def encoded(flight: sitl.flight.Flight, wood: Wood) -> Iterator[bytes | NDArray[np.uint16]]:
    """What the camera writes of each frame."""
    for index, state in enumerate(flight.states):
        if wood.kind == "colour":
            yield flight.scene.encoded(state, index)
            continue
        kelvin = warm_picture(cast(Any, flight.scene.light(state)), index)
        if wood.kind == "counts":
            yield (OFFSET + kelvin / COUNT + 0.5).astype(np.uint16)
            continue
        low, high = np.quantile(kelvin, AGC)
        grey = np.clip((kelvin - low) / (high - low) * 235 + 10.5, 0, 255).astype(np.uint8)
        if wood.kind == "palette":
            grey = cv2.applyColorMap(grey, cv2.COLORMAP_INFERNO)
        yield cv2.imencode(".jpg", grey, [cv2.IMWRITE_JPEG_QUALITY, 92])[1].tobytes()


def warm_picture(light: NDArray[np.float32], index: int) -> NDArray[np.float32]:
    """Kelvin (h, w) beside a constant that all frames share."""
    warm = cv2.GaussianBlur(np.asarray(light @ LUMINANCE[0], np.float32), (0, 0), 1.2)
    rng = np.random.default_rng([SENSOR.make, 18, index])
    noise = SENSOR.noise * rng.standard_normal(warm.shape, np.float32)
    return np.asarray((SENSOR.contrast * warm + SENSOR.pattern(SIZE) + noise) / KELVIN, np.float32)
