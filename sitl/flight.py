"""Builds a whole flight: states, pictures with camera-style names, and the ground truth."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypedDict, Unpack

import numpy as np

from .camera import SWAY, Camera, Scene
from .canopy import Canopy
from .geometry import CameraState, Lens, ground_from_pixels
from .path import SCENARIOS, Plan, fly
from .targets import Crowd, spread
from .truth import Truth, counting, grid_of, true_frame, write
from .world import COUNTRY, make_world

WORKERS = 2
AHEAD = 4  # pictures rendered in advance: about 2 MB
GSD = 0.1  # metres per pixel of the ground raster
WORLD_SIZES = (2048, 4096, 6144, 8192, 12288, 16384, 24576)  # 6144 takes 7 s to paint, 12288 half a minute and 1.2 GB
PER_FOLDER = 999  # pictures per DCIM folder


@dataclass(frozen=True, slots=True, kw_only=True)
class Flight:
    """A flight: picture names[k] is taken in states[k]. folder: where the pictures are, if written."""

    scene: Scene
    states: tuple[CameraState, ...]
    names: tuple[str, ...]
    folder: Path | None = None
    first: int = 0  # number of the first picture, in a part of a longer flight

    def truth(self) -> Truth:
        rows = enumerate(zip(self.states, self.names, strict=True))
        frames = tuple(true_frame(self.scene, state, name, self.first + index) for index, (state, name) in rows)
        camera = self.scene.camera
        return Truth(lens=camera.lens, frames=frames, targets=self.scene.targets, vignetting=camera.vignetting)

    def pictures(self) -> Iterator[bytes]:
        """The files in order of capture, rendered a few ahead on threads."""
        waiting: deque[Future[bytes]] = deque()
        with ThreadPoolExecutor(WORKERS) as pool:
            for index, state in enumerate(self.states):
                waiting.append(pool.submit(self.scene.encoded, state, self.first + index))
                if len(waiting) > AHEAD:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()


class Options(TypedDict, total=False):
    """Optional parameters of a flight.

    seed: of the ground, the wind and the noise. cache: folder of painted worlds. ground: one of GROUNDS. relief: scale
    factor of the heights, 0 for a plane. sway: as of a Scene. leaves: share of the ground that a canopy hides. camera: its
    lens keeps focal and k1, its size is overridden.
    world_size: pixels of 0.1 m; default the smallest of WORLD_SIZES that contains the flight. route: frames, height, overlaps;
    its seed is overridden. crowd: number of people, vehicles and marks.
    """

    seed: int
    cache: Path | None
    relief: float
    sway: float
    leaves: float
    ground: str
    camera: Camera
    world_size: int
    route: Plan
    crowd: Crowd


def plan(scenario: str, size: tuple[int, int] = (1200, 900), **options: Unpack[Options]) -> Flight:
    """A flight of a named scenario with pictures of `size` (width, height), not yet rendered. Raises ValueError for an
    unknown scenario, or if no world is large enough."""
    if scenario not in SCENARIOS:
        raise ValueError(f"{scenario!r} is no scenario; there are {', '.join(SCENARIOS)}")
    seed = options.get("seed", 1)
    camera = options.get("camera", Camera())
    camera = replace(camera, lens=replace(camera.lens, width=size[0], height=size[1]))
    route = replace(options.get("route", Plan()), seed=seed)
    states = fly(scenario, camera.lens, route)
    world_size = options.get("world_size") or world_size_for(states, camera.lens)
    world = make_world(seed, world_size, cache=options.get("cache"), ground=options.get("ground", COUNTRY))
    targets = spread(options.get("crowd", Crowd()), camera.lens, states, route.height, seed)
    air = {"relief": options.get("relief", 0.0), "sway": options.get("sway", SWAY)}
    leaves = options.get("leaves", 0.0)
    canopy = Canopy(leaves, seed=seed) if leaves else None
    scene = Scene(world=world, camera=camera, seed=seed, targets=targets, canopy=canopy, **air)
    return Flight(scene=scene, states=tuple(states), names=tuple(camera_names(len(states), camera.sensor.suffix)))


def world_size_for(states: list[CameraState], lens: Lens) -> int:
    """Side in pixels of the smallest world that contains all ground seen at a useful resolution."""
    grid, reach = grid_of(lens), 0.0
    for state in states:
        counts = counting(lens, state, grid)
        reach = max(reach, float(np.abs(ground_from_pixels(lens, state, grid[counts])).max(initial=0.0)))
    for size in WORLD_SIZES:
        if reach < size * GSD / 2:
            return size
    raise ValueError(
        f"the flight reaches {reach:.0f} m from its middle, the largest world {size * GSD / 2:.0f} m: fly lower"
    )


def make(scenario: str, folder: Path, size: tuple[int, int] = (1000, 750), **options: Unpack[Options]) -> Flight:
    """`plan` a flight, render its pictures into folder/DCIM and write folder/truth.json."""
    flight = replace(plan(scenario, size, **options), folder=folder)
    for name, data in zip(flight.names, flight.pictures(), strict=True):
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    write(flight.truth(), folder / "truth.json")
    return flight


def camera_names(count: int, suffix: str = ".JPG") -> Iterator[str]:
    """DCIM/100MEDIA/IMG_0001.JPG and following, POSIX paths relative to the watched folder."""
    for k in range(count):
        yield f"DCIM/{100 + k // PER_FOLDER}MEDIA/IMG_{k + 1:04d}{suffix}"
