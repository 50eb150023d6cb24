"""An anchor: the similarity that lays an island's canvas on the earth, and how far off any place of it may be.

    spot = turn * place + shift

on the plane that touches the earth in the middle of what it was fitted to, where a canvas place (x, y) is the complex number
x - iy, since the canvas' y grows downwards, and a spot is east + i north in metres. A mosaic is never mirrored.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from gcs_mosaic.geo.ellipsoid import Floats, LocalPlane, Places

CanvasPlaces: TypeAlias = npt.NDArray[np.float64]  # (..., 2): canvas units, y down
Complexes: TypeAlias = npt.NDArray[np.complex128]  # canvas places or spots of a plane

WITHIN_95 = math.sqrt(
    -2 * math.log(0.05)
)  # standard deviations: the radius of a circle with 95 % of a round distribution
RINGS, SPOKES = 32, 6
EVENLY: npt.NDArray[np.complex128] = (
    np.sqrt(-2 * np.log(1 - (np.arange(RINGS)[:, None] + 0.5) / RINGS))
    * np.exp(2j * math.pi * (np.arange(SPOKES) / SPOKES + np.arange(RINGS)[:, None] * 0.382))
).ravel()  # points of a round normal distribution with a deviation of 1 per axis, each as likely as the others
GSD_M = (0.002, 2.0)  # of a canvas unit that is believed


@dataclass(frozen=True, slots=True)
class ErrorEllipse:
    """What 95 % of the errors at a place lie within: half axes in metres, and the longer one's bearing in degrees from north."""

    major_m: float
    minor_m: float
    bearing_deg: float


@dataclass(frozen=True, slots=True)
class Alternative:
    """Another way in which an island may lie, and how likely it is; `turn_variance`, `middle_variance`: per axis, of `turn` and
    of where `middle` lies (square metres)."""

    weight: float
    turn: complex
    shift: complex
    middle: complex
    turn_variance: float
    middle_variance: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Anchor:
    """Where an island lies.

    `covariance` (4, 4): of `turn` (real, imaginary; metres per canvas unit) and of where `middle` lies (east, north; metres);
    `alternatives`: where there are any, they tell the errors instead; `map_error_m`: one standard deviation of what the map may
    be bent by itself; no half axis of an ellipse is less than `least_error_m`.
    """

    plane: LocalPlane
    turn: complex
    shift: complex
    middle: complex
    covariance: tuple[tuple[float, ...], ...] = field(repr=False)
    map_error_m: float = 0.0
    least_error_m: float = 0.0
    alternatives: tuple[Alternative, ...] = field(default=(), repr=False)

    @property
    def metres_per_unit(self) -> float:
        return abs(self.turn)

    @property
    def north_deg(self) -> float:
        """Where north is on the canvas, in degrees clockwise from up."""
        return math.degrees(np.angle(self.turn))

    def places(self, canvas: CanvasPlaces) -> Places:
        """Longitude and latitude in degrees of places on the canvas."""
        return self.plane.places(split(self.turn * joined(canvas) + self.shift))

    def canvas(self, places: Places) -> CanvasPlaces:
        """The canvas places of places on earth (degrees)."""
        back = (as_complex(self.plane.spots(places)) - self.shift) / self.turn
        return np.stack([back.real, -back.imag], axis=-1)

    def error(self, x: float, y: float) -> ErrorEllipse:
        """How far off the canvas place (x, y) may be."""
        if self.alternatives:
            radius = max(self._radius_at(complex(x, -y)), self.least_error_m)
            return ErrorEllipse(radius, radius, 0.0)
        return ellipse(self._covariance_at(complex(x, -y)), self.least_error_m)

    def _radius_at(self, place: complex) -> float:
        """Of the circle with 95 % of what the alternatives tell of a place."""
        told = np.array([(one.turn, one.shift, one.middle) for one in self.alternatives])
        spread = np.array([(one.weight, one.turn_variance, one.middle_variance) for one in self.alternatives])
        off = (told[:, 0] - self.turn) * place + told[:, 1] - self.shift
        variances = spread[:, 1] * np.abs(place - told[:, 2]) ** 2 + spread[:, 2] + self.map_error_m**2
        return _quantile(off, np.sqrt(variances), spread[:, 0])

    def _covariance_at(self, place: complex) -> Floats:
        """(2, 2) of east and north."""
        away = place - self.middle
        slopes = np.array([[away.real, -away.imag, 1.0, 0.0], [away.imag, away.real, 0.0, 1.0]])
        spread: Floats = slopes @ np.array(self.covariance) @ slopes.T
        return spread + np.eye(2) * self.map_error_m**2


def _quantile(off: Complexes, sigmas: Floats, weights: Floats) -> float:
    """The radius around 0 that holds 95 % of a mixture of round normal distributions: of points spread evenly over each."""
    distances = np.abs(off[:, None] + sigmas[:, None] * EVENLY).ravel()
    order = np.argsort(distances)
    shares = np.repeat(weights, len(EVENLY))[order]
    nearer = np.cumsum(shares) - shares
    return float(np.interp(0.95 * shares.sum(), nearer, distances[order]))


def ellipse(covariance: Floats, least_m: float = 0.0) -> ErrorEllipse:
    """Of a covariance (2, 2) of east and north in square metres."""
    variances, axes = np.linalg.eigh(covariance)
    minor, major = (max(WITHIN_95 * math.sqrt(max(float(one), 0.0)), least_m) for one in variances)
    return ErrorEllipse(major, minor, math.degrees(math.atan2(axes[0, 1], axes[1, 1])) % 180)


def joined(canvas: CanvasPlaces) -> Complexes:
    """Canvas places (..., 2) as complex numbers, y up."""
    return canvas[..., 0] - 1j * canvas[..., 1]


def as_complex(spots: Floats) -> Complexes:
    """(..., 2) as complex numbers."""
    return spots[..., 0] + 1j * spots[..., 1]


def split(spots: Complexes | Any) -> Floats:
    """Complex numbers as (..., 2)."""
    return np.stack([np.real(spots), np.imag(spots)], axis=-1)


def similarity(places: Complexes, spots: Complexes, weights: Floats) -> tuple[complex, complex]:
    """`turn` and `shift` that bring places nearest to spots, in the sense of weighted least squares."""
    share = weights / weights.sum()
    middle, target = (share * places).sum(), (share * spots).sum()
    apart = (share * np.abs(places - middle) ** 2).sum()
    turn = complex((share * np.conj(places - middle) * (spots - target)).sum() / apart)
    return turn, complex(target - turn * middle)
