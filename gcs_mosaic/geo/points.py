"""Pins of one point on earth are one point, however many pictures it is seen in.

A coordinate that is wrong is as wrong in each of its observations, so only distinct points check each other.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gcs_mosaic.geo.anchor import Complexes, as_complex
from gcs_mosaic.geo.ellipsoid import Floats, LocalPlane

USUAL_SIGMA_M = 3.0  # of a coordinate that somebody reads from a map or a receiver, in each direction
LEAST_SIGMA_M = 0.01
EQUAL_M = 0.01  # coordinates nearer than this are the same one: the seventh decimal of a degree is 1.1 cm
NAMED_ALIKE_M, NAMED_ALIKE_SIGMAS = 1.0, 4.0  # apart, of readings of a point that has one name


@dataclass(frozen=True, slots=True)
class Pin:
    """A place of an island's canvas (units), and its coordinate (degrees) with one standard deviation in metres. Pins of one
    name are observations of one point, if their coordinates agree."""

    name: str
    x: float
    y: float
    longitude_deg: float
    latitude_deg: float
    sigma_m: float = USUAL_SIGMA_M


@dataclass(frozen=True, slots=True)
class Points:
    """Distinct points. `of_pin`: for each pin its point's index; `scatter`: by what the observations of each tell its place to be
    off, one standard deviation in canvas units; `supposed`: nobody has said how exact its coordinate is."""

    names: tuple[str, ...]
    places: Complexes
    spots: Complexes
    sigmas: Floats
    scatter: Floats
    supposed: Floats
    of_pin: tuple[int, ...]


def points_of(pins: Sequence[Pin], places: Complexes, spots: Complexes) -> Points:
    """The distinct points of some pins; `places` and `spots` as in `Anchor`, one per pin."""
    of_pin = points_by_pin(pins, spots)
    groups = [[at for at, point in enumerate(of_pin) if point == number] for number in range(max(of_pin) + 1)]
    sigmas = np.array([max(pin.sigma_m, LEAST_SIGMA_M) for pin in pins])
    seen = [_seen(places[group]) for group in groups]
    told = [complex(np.average(spots[group], weights=sigmas[group] ** -2)) for group in groups]
    return Points(
        names=tuple(pins[group[0]].name for group in groups),
        places=np.array([place for place, _ in seen]),
        spots=np.array(told),
        sigmas=np.array([sigmas[group].min() for group in groups]),
        scatter=np.array([scatter for _, scatter in seen]),
        supposed=np.array([bool((sigmas[group] == USUAL_SIGMA_M).all()) for group in groups]),
        of_pin=of_pin,
    )


def number_of_points(pins: Sequence[Pin]) -> int:
    """How many distinct points they are of."""
    return 1 + max(points_by_pin(pins, as_complex(plane_of(pins).spots(coordinates(pins)))), default=-1)


def points_by_pin(pins: Sequence[Pin], spots: Complexes) -> tuple[int, ...]:
    """For each pin the index of its point: those with equal coordinates, or of one name and as near as its errors allow."""
    found: list[int] = []
    named: dict[str, list[int]] = defaultdict(list)
    for at, pin in enumerate(pins):
        same = np.flatnonzero(np.abs(spots[:at] - spots[at]) <= EQUAL_M).tolist()
        if name := pin.name.strip().casefold():
            same += [k for k in named[name] if abs(spots[k] - spots[at]) <= _allowed_m(pins[k], pin)]
            named[name].append(at)
        points = {found[k] for k in same}
        number = min(points, default=1 + max(found, default=-1))
        found = [number if one in points else one for one in found] + [number]
    order = {number: k for k, number in enumerate(dict.fromkeys(found))}
    return tuple(order[number] for number in found)


def coordinates(pins: Sequence[Pin]) -> Floats:
    """(n, 2): longitude and latitude, degrees."""
    return np.array([[pin.longitude_deg, pin.latitude_deg] for pin in pins], np.float64).reshape(-1, 2)


def plane_of(pins: Sequence[Pin]) -> LocalPlane:
    """In the middle of the pins; longitudes may lie on both sides of 180 degrees."""
    first = pins[0].longitude_deg if pins else 0.0
    east = [(pin.longitude_deg - first + 180) % 360 - 180 for pin in pins] or [0.0]
    return LocalPlane(first + sum(east) / len(east), sum(pin.latitude_deg for pin in pins) / max(len(pins), 1))


def _allowed_m(one: Pin, other: Pin) -> float:
    """Between two readings of one point. A label that is given to several points ("tree") makes them no single one."""
    return max(NAMED_ALIKE_M, NAMED_ALIKE_SIGMAS * math.hypot(one.sigma_m, other.sigma_m))


def _seen(places: Complexes) -> tuple[complex, float]:
    """Where a point is seen, and by how much its observations differ: of three or more one that is wrong does no harm."""
    if len(places) < 3:
        middle = complex(places.mean())
        return middle, float(np.abs(places - middle).max()) / 2**0.5
    middle = complex(np.median(places.real), np.median(places.imag))
    return middle, float(np.median(np.abs(places - middle))) / len(places) ** 0.5
