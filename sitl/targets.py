"""Search targets: people and vehicles that move between frames, and small static marks."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from .geometry import Array, CameraState, Lens, ground_from_pixels
from .ground.raster import Field

Colour = tuple[float, float, float]
Floats = NDArray[np.float64]
PixelsFromGround = Callable[[CameraState, Array], Array]

# BGR under full light, before vignetting; none of them is a colour of the ground.
CLOTHES: tuple[Colour, ...] = ((40, 110, 235), (225, 225, 225), (60, 215, 235), (200, 120, 40))
PAINTS: tuple[Colour, ...] = ((225, 225, 225), (45, 40, 190), (170, 70, 30))
MARK_COLOURS: tuple[Colour, ...] = ((40, 110, 235), (225, 225, 225))
PERSON = 0.6, 0.45  # metres, seen from above with a backpack
VEHICLE = 4.4, 1.8  # metres
MARK_PX = 6.0  # side of a mark in pixels of a frame at the planned height
WALK, DRIVE = (0.8, 1.6), (4.0, 9.0)  # metres per second
BEAT, ROAD = 25.0, 120.0  # metres that a person or vehicle moves before turning back
MIDDLE = 0.7  # central share of a picture in which a target is initially placed
SUBPIXELS = 8  # per axis: coverage in steps of 1/64


@dataclass(frozen=True, slots=True, kw_only=True)
class Target:
    """A flat rectangle of one colour (BGR) on the ground that moves back and forth along its heading, or is static.

    x, y: metres, position at time 0; length (along the heading), width: metres; heading: radians, clockwise from north;
    speed: metres per second; way: metres before it turns back.
    """

    kind: str  # person, vehicle or mark
    x: float
    y: float
    length: float
    width: float
    heading: float
    colour: Colour
    speed: float = 0.0
    way: float = 1.0

    def place(self, time: float) -> Floats:
        """(2,) metres: its centre at `time` seconds."""
        gone = (self.speed * time) % (2 * self.way)
        return np.asarray(np.array([self.x, self.y]) + min(gone, 2 * self.way - gone) * self.ahead)

    def corners(self, time: float) -> Floats:
        """(4, 2) metres, in cyclic order."""
        along, across = self.ahead * self.length / 2, np.array([-self.ahead[1], self.ahead[0]]) * self.width / 2
        return np.array([along + across, along - across, -along - across, across - along]) + self.place(time)

    @property
    def ahead(self) -> Floats:
        """(2,): unit vector along the heading."""
        return np.array([np.sin(self.heading), -np.cos(self.heading)])


@dataclass(frozen=True, slots=True, kw_only=True)
class Crowd:
    """Number of targets of each kind."""

    people: int = 0
    vehicles: int = 0
    marks: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class Sighting:
    """A target fully inside a picture: its number, and its centre in (2,) pixels and (2,) metres."""

    target: int
    px: Floats
    ground: Floats


def spread(crowd: Crowd, lens: Lens, states: Sequence[CameraState], height: float, seed: int) -> tuple[Target, ...]:
    """Targets distributed over the ground covered, each visible in at least one frame. height: planned, in metres."""
    rng = np.random.default_rng([seed, 8])
    mark = MARK_PX * height / lens.focal_px
    kinds = (
        ("person", crowd.people, PERSON, CLOTHES, WALK, BEAT),
        ("vehicle", crowd.vehicles, VEHICLE, PAINTS, DRIVE, ROAD),
        ("mark", crowd.marks, (mark, mark), MARK_COLOURS, (0.0, 0.0), 1.0),
    )
    return tuple(
        one_target(rng, kind, size, colours[k % len(colours)], pace, way, lens, states)
        for kind, count, size, colours, pace, way in kinds
        for k in range(count)
    )


def one_target(
    rng: np.random.Generator,
    kind: str,
    size: tuple[float, float],
    colour: Colour,
    pace: tuple[float, float],
    way: float,
    lens: Lens,
    states: Sequence[CameraState],
) -> Target:
    """A target in the central part of a randomly chosen frame at the time of that frame."""
    state = states[int(rng.integers(len(states)))]
    share = 0.5 + (rng.random(2) - 0.5) * MIDDLE
    there = ground_from_pixels(lens, state, (share * [lens.width, lens.height])[None])[0]
    if np.isnan(there).any():  # sky
        there = np.array([state.x, state.y])
    going = Target(
        kind=kind,
        x=0,
        y=0,
        length=size[0],
        width=size[1],
        heading=float(rng.uniform(0, 2 * np.pi)),
        colour=colour,
        speed=float(rng.uniform(*pace)),
        way=way,
    )
    x, y = (there - going.place(state.time)).tolist()
    return replace(going, x=x, y=y)


def sightings(
    targets: Sequence[Target], lens: Lens, state: CameraState, pixels_of: PixelsFromGround
) -> Iterator[Sighting]:
    """Targets fully inside the picture taken in this state; `pixels_of` as Scene.pixels_from_ground."""
    limits = np.array([lens.width, lens.height]) - 0.5
    for number, target in enumerate(targets):
        middle = target.place(state.time)
        seen = pixels_of(state, np.concatenate([target.corners(state.time), middle[None]]))
        if ((seen > -0.5) & (seen < limits)).all():
            yield Sighting(target=number, px=np.asarray(seen[-1], np.float64), ground=middle)


def paint_targets(light: Field, targets: Sequence[Target], state: CameraState, pixels_of: PixelsFromGround) -> None:
    """Draw targets onto the light (height, width, 3), in place, anti-aliased by pixel coverage."""
    for target in targets:
        outline = pixels_of(state, target.corners(state.time))
        if np.isfinite(outline).all():
            paint_polygon(light, outline, target.colour)


def paint_polygon(light: Field, outline: Array, colour: Colour) -> None:
    """Draw a convex polygon (n, 2) in pixels, anti-aliased."""
    limits = np.array([light.shape[1], light.shape[0]])
    low = np.clip(np.floor(outline.min(0) + 0.5), 0, limits).astype(int)
    high = np.clip(np.ceil(outline.max(0) + 0.5), 0, limits).astype(int)
    (width, height) = high - low
    if width < 1 or height < 1:
        return
    fine = np.zeros((height * SUBPIXELS, width * SUBPIXELS), np.uint8)
    inside = (outline + 0.5 - low) * SUBPIXELS - 0.5
    cv2.fillPoly(fine, [np.rint(inside).astype(np.int32)], 255)
    share = cv2.resize(fine, (int(width), int(height)), interpolation=cv2.INTER_AREA)[..., None] / np.float32(255)
    part = light[low[1] : high[1], low[0] : high[0]]
    part += share * (np.array(colour, np.float32) - part)
