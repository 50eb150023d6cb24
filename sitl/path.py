"""Flight plans: the camera pose at each picture, including wind.

A route is an ideal sequence of stations; `blown` perturbs it with wind and gusts. Every route is centred on (0, 0), fits the
default world at the default size, and grows with the number of frames.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .geometry import CameraState, Lens
from .waypoints import shots_of

TURN_SECONDS = 2.0  # per turn between two flight lines
CLIMB_RATIO = 3.0
GAP = 1.6  # picture lengths between the last frame before the gap and the first after it: no overlap, whatever the wind
LOOKS = np.radians([72, 55, 75, 66])  # tilts of oblique frames; the half field of view is 22, so most see the horizon
OBLIQUE_EVERY = 5  # frames
AHEAD = float(np.radians(60))  # tilt of a camera that looks far ahead; the horizon stays just outside
CLOSE = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """frames: approximate number (a route may need a few more); height in metres; overlaps as shares of a picture."""

    frames: int = 30
    height: float = 100.0
    forward: float = 0.75
    side: float = 0.6
    speed: float = 12.0  # metres per second over ground
    wind: float = 3.0  # metres per second, across the first line: causes the crab angle
    tilt: float = 0.05  # radians; bound of pitch and roll
    climbs: int = 0  # number of climbs of a survey to CLIMB_RATIO times its height and back
    strangers: int = 0  # frames over ground that no other frame sees (scenario `lost`)
    seed: int = 1
    waypoints: Path | None = None  # the file of scenario `mission`


@dataclass(frozen=True, slots=True, kw_only=True)
class Station:
    """A point on the ideal route. course: flight direction, clockwise from north; look: forward camera tilt; radians."""

    x: float
    y: float
    height: float
    course: float
    look: float = 0.0


Route = Callable[[Lens, Plan], list[Station]]


def fly(scenario: str, lens: Lens, plan: Plan) -> list[CameraState]:
    """The states of a named scenario. Raises KeyError for an unknown name."""
    return blown(SCENARIOS[scenario](lens, plan), plan)


def steps(lens: Lens, plan: Plan) -> tuple[float, float]:
    """Metres between pictures along a line and between lines, at the plan's height."""
    across, along = lens.footprint(plan.height)
    return along * (1 - plan.forward), across * (1 - plan.side)


def survey(lens: Lens, plan: Plan) -> list[Station]:
    """A lawnmower pattern, level or with climbs, over as square an area as the number of frames allows.

    Line spacing follows from the plan's height, so a climb only adds overlap.
    """
    step, spacing = steps(lens, plan)
    lines = max(1, round(np.sqrt(plan.frames * step / spacing)))
    per_line = -(-plan.frames // lines)
    middle_x, middle_y = (lines - 1) / 2 * spacing, (per_line - 1) / 2 * step
    stations = []
    for k in range(plan.frames):
        line, place = divmod(k, per_line)
        north = line % 2 == 0
        y = (middle_y - place * step) if north else (place * step - middle_y)
        course = 0.0 if north else np.pi
        height = plan.height * climbed(k / plan.frames, plan.climbs)
        stations.append(Station(x=line * spacing - middle_x, y=y, height=height, course=course))
    return stations


def climbed(share: float, climbs: int) -> float:
    """Height factor after this share of a flight: smoothly from 1 to CLIMB_RATIO and back, `climbs` times."""
    return float(CLIMB_RATIO ** (0.5 - 0.5 * np.cos(2 * np.pi * climbs * share)))


def climb(lens: Lens, plan: Plan) -> list[Station]:
    """An outward spiral that ends at three times its initial height (0.8 of the plan's)."""
    stations, turn, radius = [], 0.0, 0.15 * plan.height
    for height in 0.8 * plan.height * CLIMB_RATIO ** np.linspace(0, 1, plan.frames):
        x, y = radius * np.cos(turn), radius * np.sin(turn)
        stations.append(Station(x=x, y=y, height=float(height), course=turn + np.pi))
        across, along = lens.footprint(float(height))
        advance = along * (1 - plan.forward) / radius
        turn, radius = turn + advance, radius + across * (1 - plan.side) * advance / (2 * np.pi) * 0.8
    return stations


def lost(lens: Lens, plan: Plan) -> list[Station]:
    """East, a gap without frames, at least three frames beyond it; then back west alongside, bridging the gap."""
    step, spacing = steps(lens, plan)
    gap = lens.footprint(plan.height)[1] * GAP
    both = max(8, round((plan.frames - gap / step) / 2))
    second = max(3, both // 3)
    first = both - second
    out = [k * step for k in range(first)] + [(first - 1) * step + gap + k * step for k in range(second)]
    back = list(np.linspace(out[-1], 0, round(out[-1] / step) + 1))
    middle, row = out[-1] / 2, -0.6 * plan.height
    east = [Station(x=x - middle, y=row, height=plan.height, course=np.pi / 2) for x in out]
    west = [Station(x=float(x) - middle, y=row + spacing, height=plan.height, course=-np.pi / 2) for x in back]
    return east[:first] + strangers(plan, middle) + east[first:] + west


def strangers(plan: Plan, middle: float) -> list[Station]:
    """Stations far south of all others, and far apart."""
    sides = np.linspace(-1, 1, plan.strangers) if plan.strangers > 1 else np.zeros(plan.strangers)
    return [Station(x=float(k) * middle, y=2.0 * plan.height, height=plan.height, course=0.4) for k in sides]


def oblique(lens: Lens, plan: Plan) -> list[Station]:
    """A survey with regular oblique frames towards the middle of the area, up to the horizon and the sky."""
    stations = survey(lens, plan)
    for n, k in enumerate(range(OBLIQUE_EVERY - 1, len(stations), OBLIQUE_EVERY)):
        at = stations[k]
        inwards = float(np.arctan2(-at.x, at.y))
        look = float(LOOKS[n % len(LOOKS)])
        stations[k] = Station(x=at.x, y=at.y, height=at.height, course=inwards, look=look)
    return stations


def ahead(lens: Lens, plan: Plan) -> list[Station]:
    """North along one line with a camera that looks far ahead: two frames fit another plane as well. Not beyond the world: the
    more frames, the closer."""
    step = min(steps(lens, plan)[0], 2 * plan.height / max(plan.frames - 1, 1))
    south = (plan.frames - 1) / 2 * step + plan.height
    along = np.arange(plan.frames) * step
    return [Station(x=0.0, y=float(south - at), height=plan.height, course=0.0, look=AHEAD) for at in along]


def line(lens: Lens, plan: Plan) -> list[Station]:
    """North along one line, pictures CLOSE times as close as the forward overlap says: many looks at few places."""
    step = steps(lens, plan)[0] / CLOSE
    south = (plan.frames - 1) / 2 * step
    return [Station(x=0.0, y=south - k * step, height=plan.height, course=0.0) for k in range(plan.frames)]


def circle(lens: Lens, plan: Plan) -> list[Station]:
    """Once around the middle, which every picture shows: a quarter of a picture's shorter side away from it."""
    radius = min(lens.footprint(plan.height)) / 4
    turns = np.arange(plan.frames) / plan.frames * 2 * np.pi
    places = radius * np.stack([np.sin(turns), -np.cos(turns)], axis=-1)
    return [
        Station(x=float(x), y=float(y), height=plan.height, course=float(turn + np.pi / 2))
        for (x, y), turn in zip(places, turns, strict=True)
    ]


def mission(_lens: Lens, plan: Plan) -> list[Station]:
    """The pictures of a mission file. Raises ValueError without one."""
    if plan.waypoints is None:
        raise ValueError("--scenario mission wants --waypoints FILE")
    return [Station(x=one.x, y=one.y, height=one.height, course=one.course) for one in shots_of(plan.waypoints)]


SCENARIOS: dict[str, Route] = {
    "survey": survey,
    "climb": climb,
    "lost": lost,
    "oblique": oblique,
    "ahead": ahead,
    "line": line,
    "circle": circle,
    "mission": mission,
}


def blown(route: list[Station], plan: Plan) -> list[CameraState]:
    """Apply wind to a route: crab angle; gusts in position, height, heading and attitude; and the flight time."""
    rng = np.random.default_rng([plan.seed, 5])
    count, times = len(route), clock(route, plan)
    east, south = gusts(rng, count) * 1.2, gusts(rng, count) * 1.2
    up, swing = gusts(rng, count) * 0.008, gusts(rng, count) * 0.03
    pitch, roll = (np.clip(gusts(rng, count) * plan.tilt / 2, -plan.tilt, plan.tilt) for _ in range(2))
    return [
        CameraState(
            time=times[k],
            x=at.x + east[k],
            y=at.y + south[k],
            height=at.height * (1 + up[k]),
            yaw=at.course + crab(at.course, plan) + swing[k],
            pitch=pitch[k] + at.look,
            roll=roll[k],
        )
        for k, at in enumerate(route)
    ]


def crab(course: float, plan: Plan) -> float:
    """Crab angle into a wind from the west that keeps the course."""
    return float(np.arcsin(np.clip(-plan.wind / max(plan.speed, 0.1) * np.cos(course), -0.5, 0.5)))


def gusts(rng: np.random.Generator, count: int) -> NDArray[np.float64]:
    """(count,) correlated noise (AR(1), coefficient 0.6) of standard deviation 1."""
    values = rng.standard_normal(count)
    for k in range(1, count):
        values[k] = 0.6 * values[k - 1] + 0.8 * values[k]
    return values


def clock(route: list[Station], plan: Plan) -> list[float]:
    """Seconds since the start at each station."""
    times = [0.0]
    for before, after in pairwise(route):
        way = float(np.hypot(after.x - before.x, after.y - before.y))
        turned = abs(after.course - before.course) > 1.0
        times.append(times[-1] + way / plan.speed + TURN_SECONDS * turned)
    return times[: len(route)]
