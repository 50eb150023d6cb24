"""An archive that invites false joins: strangers, repeated structures, and second visits a year later; the truth is known.

Flights of 12 to 24 small frames over flat lands. Two fifths of the frames see realistic lands that have nothing in common, two
fifths lands built of one make of halls, blocks, cars, rows or plants in different arrangement, a fifth lands that are visited
twice. The second visits come last: with the sun elsewhere, other gain, gamma and colour, a part of the ground grown over by
another, another height and another heading. All of it follows from the number of frames.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import cycle
from multiprocessing import get_context
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from sitl.camera import Camera, Scene
from sitl.geometry import CameraState, Lens, ground_from_pixels, pixels_from_ground
from sitl.ground import objects
from sitl.ground.land import lay_out
from sitl.ground.noise import fractal
from sitl.ground.paint import paint
from sitl.path import Plan, fly
from sitl.world import BARE, COUNTRY, RAISED, World, pyramid

Array = NDArray[np.float64]
Image = NDArray[np.uint8]

LENS = Lens(width=400, height=300)
GSD = 0.1  # metres per pixel of a land
ONCE, TWICE = 2048, 2560  # pixels along a land that is visited so often
HEIGHT = 60.0  # metres; each picture shows 66 x 50 of them
FLIGHT, REPEATED, REVISITED = 20, 24, 12  # frames of a flight
APART_SEEDS = 100_000  # between the seed of a land and that of what grows over it
SUNS = np.array(
    [[0.62, 0.3], [0.1, -0.9], [-0.2, 0.75]]
)  # metres of shadow per metre of height; sitl's is (-0.62, -0.45)

REALISTIC = ("country", "suburb", "canopy", "country")
MADE_ALIKE = ("halls", "quarter", "cars", "rows", "vines", "berries", "maize", "orchard")
BARRACKS = "barracks"  # which the program is known to confuse
VISITED_TWICE = ("country", "suburb", "halls", "country", "quarter", "canopy")
GROWN = (0.0, 0.25, 0.5)  # shares of the ground that another has taken a year later
HEIGHTS = (1.0, 0.75, 1.4)  # of the second visit, relative to the first


@dataclass(frozen=True, slots=True, kw_only=True)
class Later:
    """What is different a year later; `cast`: factors of blue, green and red."""

    grown: float
    height: float
    heading: float
    sun: int
    gain: float
    gamma: float
    cast: tuple[float, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Visit:
    """A flight: `frames` from number `first` on, over the land of this number; `later` for a second visit."""

    land: int
    ground: str
    first: int
    frames: int
    later: Later | None = None


@dataclass(frozen=True, slots=True)
class Taken:
    """Where a frame was taken, on which visit."""

    visit: Visit
    state: CameraState

    @property
    def land(self) -> int:
        return self.visit.land


def visits(frames: int, *, barracks: bool = False) -> list[Visit]:
    """The flights of an archive of so many frames, or a few more."""
    flights = list(_flights(frames, (*MADE_ALIKE, BARRACKS) if barracks else MADE_ALIKE))
    again = [one for one in flights if one.frames == REVISITED]
    start = sum(one.frames for one in flights)
    return flights + [replace(one, first=start + REVISITED * k, later=_later(one.land)) for k, one in enumerate(again)]


def _flights(frames: int, alike: Sequence[str]) -> Iterator[Visit]:
    """First visits of all lands; next is always the kind that has the fewest frames of its share so far."""
    kinds = {
        "apart": (cycle(REALISTIC), cycle([FLIGHT]), 0.4),
        "alike": (cycle(alike), cycle([FLIGHT, REPEATED]), 0.4),
        "twice": (cycle(VISITED_TWICE), cycle([REVISITED]), 0.1),
    }
    have, land, first = dict.fromkeys(kinds, 0.0), 0, 0
    while first + have["twice"] * kinds["twice"][2] < frames:
        kind = min(have, key=lambda name: have[name])
        grounds, counts, share = kinds[kind]
        visit = Visit(land=land, ground=next(grounds), first=first, frames=next(counts))
        yield visit
        have[kind] += visit.frames / share
        land, first = land + 1, first + visit.frames


def _later(land: int) -> Later:
    """What is different on the second visit to a land."""
    rng = np.random.default_rng([land, 31])
    return Later(
        grown=float(rng.choice(GROWN)),
        height=float(rng.choice(HEIGHTS)),
        heading=float(rng.uniform(0.3, 2 * np.pi - 0.3)),
        sun=int(rng.integers(len(SUNS))),
        gain=float(rng.uniform(0.75, 1.2)),
        gamma=float(rng.uniform(0.8, 1.25)),
        cast=tuple(rng.uniform(0.92, 1.08, 3).tolist()),
    )


def taken(flights: Sequence[Visit]) -> list[Taken]:
    """All frames by number."""
    return [Taken(visit, state) for visit in flights for state in states(visit)]


def states(visit: Visit) -> list[CameraState]:
    """How the frames of a visit are taken: a survey of a few lines, turned about the middle of the land on a second visit."""
    later = visit.later
    height = HEIGHT * (later.height if later else 1.0)
    plan = Plan(frames=visit.frames, height=height, forward=0.6, side=0.45, seed=visit.first + 1)
    flown = fly("survey", LENS, plan)
    return [_turned(state, later.heading) for state in flown] if later else flown


def _turned(state: CameraState, heading: float) -> CameraState:
    c, s = np.cos(heading), np.sin(heading)
    return replace(
        state, x=float(c * state.x - s * state.y), y=float(s * state.x + c * state.y), yaw=state.yaw + heading
    )


def seen_by(b: CameraState, a: CameraState, pixels: Array) -> Array:
    """Pixels (n, 2) of frame a -> pixels of frame b that show the same spots of one land."""
    return np.asarray(pixels_from_ground(LENS, b, ground_from_pixels(LENS, a, pixels)), np.float64)


def grid() -> Array:
    """Pixels (n, 2) all over a frame."""
    x, y = np.meshgrid(np.linspace(0, LENS.width - 1, 17), np.linspace(0, LENS.height - 1, 13))
    return np.stack([x.ravel(), y.ravel()], axis=1)


@lru_cache(maxsize=4)
def world_of(visit: Visit) -> World:
    """The land as it is then."""
    picture = _painted(visit, visit.land + 1)
    later = visit.later
    if later is not None:
        picture = in_light(_grown_over(picture, visit, later), later)
    return World(pyramid(picture), np.zeros((1, 1), np.float32), GSD)


def _painted(visit: Visit, seed: int) -> Image:
    size = TWICE if visit.frames == REVISITED else ONCE
    with sun_at(visit.later.sun if visit.later else None):
        if visit.ground in RAISED:
            return RAISED[visit.ground](seed, size, GSD)[0]
        if visit.ground == COUNTRY:
            return paint(lay_out(seed, size * GSD), seed, size, GSD)
        return BARE[visit.ground](seed, size, GSD)


@contextmanager
def sun_at(number: int | None) -> Iterator[None]:
    """Shadows and lit sides are painted for one of SUNS, not for sitl's own."""
    before = objects.SUN.copy()
    objects.SUN[:] = before if number is None else SUNS[number]
    try:
        yield
    finally:
        objects.SUN[:] = before


def _grown_over(own: Image, visit: Visit, later: Later) -> Image:
    """A picture of which another has taken a share, in patches of some ten metres."""
    if not later.grown:
        return own
    other = _painted(visit, visit.land + APART_SEEDS)
    patches = fractal(np.random.default_rng([visit.land, 32]), len(own), coarsest=256, finest=32)
    gone = np.clip((patches - np.quantile(patches, 1 - later.grown)) * 4 + 0.5, 0, 1)[..., None]
    return np.asarray(own + gone * (other.astype(np.float32) - own), np.uint8)


def in_light(picture: Image, later: Later) -> Image:
    """A picture with another gain, gamma and colour."""
    levels = np.arange(256)[:, None] / 255 * np.array(later.cast)
    curves = np.clip(255 * later.gain * levels**later.gamma, 0, 255).astype(np.uint8)
    return np.asarray(cv2.LUT(picture, curves[:, None, :]), np.uint8)


def archive_in(folder: Path, flights: Sequence[Visit], processes: int = 2) -> Path:
    """A folder with all frames, by number; rendered if it is not there yet."""
    if folder.is_dir():
        return folder
    beside = folder.with_name(folder.name + "-unfinished")
    beside.mkdir(parents=True, exist_ok=True)
    with get_context("spawn").Pool(processes) as pool:
        pool.starmap(render, [(visit, beside) for visit in flights], chunksize=1)
    return beside.rename(folder)


def render(visit: Visit, folder: Path) -> None:
    """The frames of a visit, as JPEG."""
    cv2.setNumThreads(1)
    if (folder / name_of(visit.first + visit.frames - 1)).exists():
        return
    scene = Scene(world=world_of(visit), camera=Camera(lens=LENS), seed=visit.first + 1)
    for k, state in enumerate(states(visit)):
        (folder / name_of(visit.first + k)).write_bytes(scene.encoded(state, k))


def name_of(number: int) -> str:
    return f"frame-{number:06}.jpg"


def number_of(name: str) -> int:
    """The number of the frame with this name."""
    return int(name[6:12])
