"""Whether the stated error of a map that control points lay holds: simulated sets with gross errors.

    python -m tests.benchmarks.control_points [SETS]

Each set has 2 to 8 points, spread, in a line or in a cluster with one far away; each is seen in 1 to 6 pictures and pointed at
to 1 to 5 pixels. In two of three sets the coordinate of one point is wrong by 10 to 100 m. Printed is how often the true place
of the map's middle and of its corners lies within the stated 95 %, by the number of points and of all sets.
"""

from __future__ import annotations

import math
import sys
from collections import Counter, defaultdict
from dataclasses import dataclass

import numpy as np

from gcs_mosaic.geo.anchor import Anchor
from gcs_mosaic.geo.ellipsoid import LocalPlane
from gcs_mosaic.geo.pins import Pin, PinnedMap, anchored_by_pins

PLANE, GSD_M, NORTH_RAD = LocalPlane(9.0, 48.7), 0.08, 0.6
TRUTH = Anchor(
    plane=PLANE,
    turn=GSD_M * complex(math.cos(NORTH_RAD), math.sin(NORTH_RAD)),
    shift=complex(30.0, -70.0),
    middle=0j,
    covariance=((0.0,) * 4,) * 4,
)
SIDE = 6000.0  # of the map, canvas units
SHAPES = ("spread", "line", "cluster")


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulatedSet:
    """`wrong`: the point whose coordinate is wrong, if any."""

    pins: tuple[Pin, ...]
    points: int
    wrong: str | None


def simulated(
    chance: np.random.Generator, *, gross: float = 2 / 3, sigma_m: float = 3.0, noise_m: float = 3.0
) -> SimulatedSet:
    """Points whose coordinates are off by `noise_m` (one standard deviation in each direction) and said to be by `sigma_m`."""
    count, pixels = int(chance.integers(2, 9)), chance.uniform(1, 5)
    places = _places(chance, count)
    wrong = int(chance.integers(count)) if chance.random() < gross else None
    pins = []
    for at, place in enumerate(places):
        off = chance.normal(0, noise_m, 2)
        if at == wrong:
            angle, metres = chance.uniform(0, 2 * math.pi), chance.uniform(10, 100)
            off += metres * math.cos(angle), metres * math.sin(angle)
        longitude, latitude = PLANE.places(PLANE.spots(TRUTH.places(place)) + off).tolist()
        for _ in range(int(chance.integers(1, 7))):
            x, y = place + chance.normal(0, pixels, 2)
            pins.append(Pin(f"gcp{at}", x, y, longitude, latitude, sigma_m))
    return SimulatedSet(pins=tuple(pins), points=count, wrong=None if wrong is None else f"gcp{wrong}")


def _places(chance: np.random.Generator, count: int) -> np.ndarray:
    shape = SHAPES[chance.integers(len(SHAPES))]
    places = chance.uniform(0, SIDE, (count, 2))
    if shape == "line":
        places[:, 1] = 0.3 * places[:, 0] + chance.normal(0, 20, count)
    if shape == "cluster":
        places[1:] = places[0] + chance.normal(0, SIDE / 20, (count - 1, 2))
        places[0] = SIDE - places[0]
    return places


def within(found: PinnedMap) -> list[bool]:
    """Whether the true places of the map's middle and of a corner lie within what is stated there."""
    looked_at = ((SIDE / 2, SIDE / 2), (0.0, 0.0), (SIDE, 0.0), (SIDE, SIDE), (0.0, SIDE))
    return [off_m(found.anchor, x, y) <= found.anchor.error(x, y).major_m for x, y in looked_at]


def off_m(anchor: Anchor, x: float, y: float) -> float:
    place = np.array([x, y])
    return float(np.linalg.norm(PLANE.spots(anchor.places(place)) - PLANE.spots(TRUTH.places(place))))


SITUATIONS: dict[str, dict[str, float]] = {
    "coordinates as exact as is said (3 m)": {},
    "said to be 0.5 m, and are": {"sigma_m": 0.5, "noise_m": 0.5},
    "measured to 2 cm, nothing said": {"noise_m": 0.02},
    "measured to 2 cm, and said": {"sigma_m": 0.02, "noise_m": 0.02},
    "twice as bad as said": {"sigma_m": 1.0, "noise_m": 2.0},
    "no gross errors": {"gross": 0.0},
    "a gross error in each": {"gross": 1.0},
}


def judged(one: SimulatedSet, found: PinnedMap) -> str:
    """What was said of the point that is wrong."""
    if found.misfits:
        return "named" if found.misfits == (one.wrong,) else "misnamed"
    return (
        "missed" if found.is_checked and one.wrong is not None else "unchecked" if not found.is_checked else "checked"
    )


def measured(sets: int, situation: str) -> dict[int, list[tuple[list[bool], float, str]]]:
    """By the number of points: where the stated error holds, what it is in the middle, and what was said."""
    chance, told = np.random.default_rng(1), defaultdict[int, list[tuple[list[bool], float, str]]](list)
    count = 0
    while count < sets:
        one = simulated(chance, **SITUATIONS[situation])
        found = anchored_by_pins(one.pins)
        if isinstance(found, PinnedMap):  # else the points are too near for their errors
            count += 1
            in_the_middle = found.anchor.error(SIDE / 2, SIDE / 2).major_m
            told[one.points].append((within(found), in_the_middle, judged(one, found)))
    return told


def main(sets: int) -> None:
    for situation in SITUATIONS:
        told = measured(sets, situation)
        print(f"{situation}: {np.mean([held for some in told.values() for held, _, _ in some]):.1%} of {sets} sets")
        for points, some in sorted(told.items()):
            held, stated = np.mean([one for one, _, _ in some]), np.median([one for _, one, _ in some])
            words = Counter(word for _, _, word in some)
            said = ", ".join(f"{word} {count}" for word, count in sorted(words.items()))
            print(f"  {points} points: {held:6.1%}, \u00b1 {stated:.1f} m; {said}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 500)
