"""An anchor by pins: places of the map whose coordinates somebody knows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gcs_mosaic.geo.anchor import (
    GSD_M,
    WITHIN_95,
    Anchor,
    Complexes,
    as_complex,
    joined,
    similarity,
)
from gcs_mosaic.geo.ellipsoid import FURTHEST_M, Floats, LocalPlane

USUAL_SIGMA_M = 3.0  # of a coordinate that somebody reads from a map or a receiver, in each direction
LEAST_SIGMA_M = 0.01
APART_SIGMAS = 10.0  # of two pins: nearer ones turn the map by more than 8 degrees of one standard deviation
MISFIT_SIGMAS = 3.0  # a pin further from where the map lays it does not fit
UNUSUAL = 2.75  # standard deviations of a normal distribution: 99.7 % are below


@dataclass(frozen=True, slots=True)
class Pin:
    """A place of an island's canvas (units), and its coordinate (degrees) with one standard deviation in metres."""

    name: str
    x: float
    y: float
    longitude_deg: float
    latitude_deg: float
    sigma_m: float = USUAL_SIGMA_M


@dataclass(frozen=True, slots=True)
class PinnedMap:
    """An anchor, and each pin's distance (metres) from where the map lays it.

    Two pins always fit, so they check nothing. Of three that do not fit nobody can say which is wrong; of more `misfit` does.
    Where they do not fit, the anchor's stated error is what they tell of it, not what was said of each.
    """

    anchor: Anchor
    residuals_m: tuple[float, ...]
    fits: bool
    misfit: str | None = None

    @property
    def is_checked(self) -> bool:
        return len(self.residuals_m) > 2 and self.fits


@dataclass(frozen=True, slots=True)
class Refused:
    """There is no anchor: one sentence says why, and what to do."""

    reason: str


def anchored_by_pins(pins: Sequence[Pin], map_error_units: float = 0.0) -> PinnedMap | Refused:
    """The anchor of least squares; `map_error_units`: what the map may be bent by, one standard deviation in canvas units."""
    if len(pins) < 2:
        return Refused(f"An anchor needs two pins or more, and has {len(pins)}: set another one, far from the first.")
    places = joined(np.array([[pin.x, pin.y] for pin in pins], np.float64))
    plane = _plane(pins)
    spots = as_complex(plane.spots(np.array([[pin.longitude_deg, pin.latitude_deg] for pin in pins])))
    refused = _refused(pins, places, spots)
    if refused is not None:
        return refused
    sigmas = np.array([max(pin.sigma_m, LEAST_SIGMA_M) for pin in pins])
    turn, shift = similarity(places, spots, sigmas**-2)
    if not GSD_M[0] <= abs(turn) <= GSD_M[1]:
        return Refused(_absurd(turn))
    anchor = _anchor(plane, turn, shift, places, sigmas)
    anchor = replace(anchor, map_error_m=map_error_units * abs(turn))
    residuals = tuple(map(float, np.abs(turn * places + shift - spots)))
    sigmas = np.hypot(sigmas, anchor.map_error_m)
    if misfit_of(places, spots, sigmas) <= 1:
        return PinnedMap(anchor, residuals, fits=True)
    anchor = _widened(anchor, residuals, sigmas)
    return PinnedMap(anchor, residuals, fits=False, misfit=_wrong_one(pins, places, spots, sigmas))


def _refused(pins: Sequence[Pin], places: Complexes, spots: Complexes) -> Refused | None:
    if not np.isfinite(places).all() or not np.isfinite(spots).all() or np.abs(spots).max() > FURTHEST_M / 2:
        return Refused(
            "The pins' coordinates are further apart than any flight: look for latitude and longitude exchanged, or a sign."
        )
    sigmas = np.array([max(pin.sigma_m, LEAST_SIGMA_M) for pin in pins])
    if _turn_sigma(spots, sigmas) > math.sqrt(2) / APART_SIGMAS:
        needed = APART_SIGMAS * float(sigmas.max())
        return Refused(
            f"The pins' coordinates lie within {_extent(spots):.0f} m, which with their errors tells no direction: "
            f"set them {needed:.0f} m apart or further, or say that they are more exact (sigma)."
        )
    if _extent(places) < 1.0:
        return Refused("The pins lie on the same spot of the map: set another one, far from the first.")
    return None


def _absurd(turn: complex) -> str:
    return (
        f"By these pins a pixel of the map would be {abs(turn):.3g} m, and {GSD_M[0]:g} to {GSD_M[1]:g} m are believed: "
        "one of them is at another place, or latitude and longitude are exchanged."
    )


def _anchor(plane: LocalPlane, turn: complex, shift: complex, places: Complexes, sigmas: Floats) -> Anchor:
    share = sigmas**-2 / (sigmas**-2).sum()
    middle = complex((share * places).sum())
    at_middle = float(1 / (sigmas**-2).sum())
    of_turn = float(1 / (sigmas**-2 * np.abs(places - middle) ** 2).sum())
    covariance = np.diag([of_turn, of_turn, at_middle, at_middle])
    rows = tuple(tuple(map(float, row)) for row in covariance)
    return Anchor(plane=plane, turn=turn, shift=shift, middle=middle, covariance=rows)


def _widened(anchor: Anchor, residuals: Sequence[float], sigmas: Floats) -> Anchor:
    """With the deviation that the residuals tell; few of them tell it badly: the radius is that of Student's distribution."""
    freedom = 2 * len(residuals) - 4
    measured = math.sqrt(float(((np.array(residuals) / sigmas) ** 2).sum()) / freedom)
    factor = max(measured * math.sqrt(freedom * (0.05 ** (-2 / freedom) - 1)) / WITHIN_95, 1.0)
    return replace(anchor, covariance=tuple(tuple(factor**2 * one for one in row) for row in anchor.covariance))


def misfit_of(places: Complexes, spots: Complexes, sigmas: Floats) -> float:
    """How badly the pins fit: above 1 they are not believed, by the worst of them or by all together."""
    freedom = 2 * len(places) - 4
    if freedom <= 0:
        return 0.0
    turn, shift = similarity(places, spots, sigmas**-2)
    missed = np.abs(turn * places + shift - spots) / sigmas
    spread = 2 / (9 * freedom)
    most = freedom * (1 - spread + UNUSUAL * math.sqrt(spread)) ** 3  # Wilson and Hilferty, of the sum of squares
    return float(max(missed.max() / MISFIT_SIGMAS, (missed**2).sum() / most))


def _wrong_one(pins: Sequence[Pin], places: Complexes, spots: Complexes, sigmas: Floats) -> str | None:
    """The pin without which the others fit, and best."""
    if len(pins) < 4:
        return None
    rest = [misfit_of(np.delete(places, at), np.delete(spots, at), np.delete(sigmas, at)) for at in range(len(pins))]
    return pins[int(np.argmin(rest))].name if min(rest) <= 1 else None


def _plane(pins: Sequence[Pin]) -> LocalPlane:
    """In the middle of the pins; longitudes may lie on both sides of 180 degrees."""
    first = pins[0].longitude_deg
    east = [(pin.longitude_deg - first + 180) % 360 - 180 for pin in pins]
    return LocalPlane(first + sum(east) / len(east), sum(pin.latitude_deg for pin in pins) / len(pins))


def _turn_sigma(spots: Complexes, sigmas: Floats) -> float:
    """One standard deviation, in radians, of how the pins turn the map: a vague one beside exact ones does no harm."""
    weights = sigmas**-2
    spread = float((weights * np.abs(spots - (weights * spots).sum() / weights.sum()) ** 2).sum())
    return math.inf if spread == 0 else 1 / math.sqrt(spread)


def _extent(points: Complexes) -> float:
    return float(np.abs(points[:, None] - points[None, :]).max())
