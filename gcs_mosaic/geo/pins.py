"""An anchor by pins: places of the map whose coordinates somebody knows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

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
from gcs_mosaic.geo.gross_errors import Supposition, suppositions
from gcs_mosaic.geo.points import USUAL_SIGMA_M, Pin, Points, coordinates, plane_of, points_of

__all__ = ["USUAL_SIGMA_M", "Pin", "PinnedMap", "Refused", "anchored_by_pins", "misfit_of"]

APART_SIGMAS = 10.0  # of two pins: nearer ones turn the map by more than 8 degrees of one standard deviation
MISFIT_SIGMAS = 3.0  # a pin further from where the map lays it does not fit
UNUSUAL = 2.75  # standard deviations of a normal distribution: 99.7 % are below
POINTED_UNITS = 2.0  # how exactly people point at a place, one standard deviation in canvas units
SURE = 0.9  # of all that is likely: so much of it must say the same


@dataclass(frozen=True, slots=True)
class PinnedMap:
    """An anchor, and each pin's distance (metres) from where the map lays it.

    `points`: how many distinct ones the pins are of; only those check each other. `fits`: all of them do; `checked`: a gross
    error of one of them would have been seen. `misfits`: the points that are wrong, without which the map is laid. The anchor's
    stated error is that of all that may be wrong: of two points one may be.
    """

    anchor: Anchor
    residuals_m: tuple[float, ...]
    fits: bool
    points: int
    checked: bool = False
    misfits: tuple[str, ...] = ()
    if_right_m: float = 0.0  # the error in the middle (95 %) if all coordinates are as exact as is said

    @property
    def misfit(self) -> str | None:
        return self.misfits[0] if self.misfits else None

    @property
    def is_checked(self) -> bool:
        return self.fits and self.checked


@dataclass(frozen=True, slots=True)
class Refused:
    """There is no anchor: one sentence says why, and what to do."""

    reason: str


def anchored_by_pins(pins: Sequence[Pin], map_error_units: float = 0.0) -> PinnedMap | Refused:
    """The anchor that pins tell; `map_error_units`: what the map may be bent by, one standard deviation in canvas units."""
    places = joined(np.array([[pin.x, pin.y] for pin in pins], np.float64).reshape(-1, 2))
    plane = plane_of(pins)
    spots = as_complex(plane.spots(coordinates(pins)))
    if not np.isfinite(places).all() or not np.isfinite(spots).all() or np.abs(spots).max(initial=0) > FURTHEST_M / 2:
        return Refused(
            "The pins' coordinates are further apart than any flight: look for latitude and longitude exchanged, or a sign."
        )
    points = points_of(pins, places, spots)
    refused = _refused(pins, points)
    if refused is not None:
        return refused
    turn, _ = similarity(points.places, points.spots, points.sigmas**-2)
    others = np.hypot(points.scatter, math.hypot(map_error_units, POINTED_UNITS)) * abs(turn)
    told = suppositions(points.places, points.spots, points.sigmas, others, points.supposed)
    anchor = _anchor(plane, told, map_error_units)
    if not GSD_M[0] <= abs(anchor.turn) <= GSD_M[1]:
        return Refused(_absurd(anchor.turn))
    residuals = tuple(map(float, np.abs(anchor.turn * places + anchor.shift - spots)))
    return _judged(anchor, residuals, points, told)


def _judged(anchor: Anchor, residuals: tuple[float, ...], points: Points, told: Sequence[Supposition]) -> PinnedMap:
    count = len(points.names)
    wrong = _surely_wrong(told)
    all_right = next((one for one in told if not one.wrong), None)
    weight = 0.0 if all_right is None else all_right.weight
    sigmas = np.hypot(points.sigmas, np.hypot(POINTED_UNITS * abs(anchor.turn), anchor.map_error_m))
    fits = count == 2 or (weight > 0.5 and misfit_of(points.places, points.spots, sigmas) <= 1)
    return PinnedMap(
        anchor,
        residuals,
        fits,
        count,
        checked=count > 2 and weight >= SURE,
        misfits=tuple(points.names[one] for one in sorted(wrong)),
        if_right_m=WITHIN_95 * math.hypot(float((sigmas**-2).sum()) ** -0.5, anchor.map_error_m),
    )


def _refused(pins: Sequence[Pin], points: Points) -> Refused | None:
    count = len(points.names)
    if count < 2:
        if len(pins) > 1:
            needed = APART_SIGMAS * float(points.sigmas.max())
            return Refused(
                f"The {len(pins)} pins are of a single point: set one of another, {needed:.0f} m apart or further."
            )
        return Refused(f"An anchor needs two pins or more, and has {len(pins)}: set another one, far from the first.")
    if _turn_sigma(points.spots, points.sigmas) > math.sqrt(2) / APART_SIGMAS:
        needed = APART_SIGMAS * float(points.sigmas.max())
        return Refused(
            f"The pins' coordinates lie within {_extent(points.spots):.0f} m, which with their errors tells no direction: "
            f"set them {needed:.0f} m apart or further, or say that they are more exact (sigma)."
        )
    if _extent(points.places) < 1.0:
        return Refused("The pins lie on the same spot of the map: set another one, far from the first.")
    return None


def _absurd(turn: complex) -> str:
    return (
        f"By these pins a pixel of the map would be {abs(turn):.3g} m, and {GSD_M[0]:g} to {GSD_M[1]:g} m are believed: "
        "one of them is at another place, or latitude and longitude are exchanged."
    )


def _anchor(plane: LocalPlane, told: Sequence[Supposition], map_error_units: float) -> Anchor:
    """The middle of what is likely: of the likeliest supposition if that is sure, else of all that leave out what is wrong."""
    wrong = _surely_wrong(told)
    followed = told[:1] if told[0].weight >= SURE else [one for one in told if wrong <= one.wrong]
    ways = [one for supposition in followed for one in supposition.alternatives]
    share = np.array([one.weight for one in ways])
    turn, middle = (
        complex(np.average([getattr(one, name) for one in ways], weights=share)) for name in ("turn", "middle")
    )
    spot = complex(np.average([one.turn * middle + one.shift for one in ways], weights=share))
    of_turn, of_middle = (
        float(np.average([getattr(one, name) for one in ways], weights=share))
        for name in ("turn_variance", "middle_variance")
    )
    rows = tuple(tuple(map(float, row)) for row in np.diag([of_turn, of_turn, of_middle, of_middle]))
    return Anchor(
        plane=plane,
        turn=turn,
        shift=spot - turn * middle,
        middle=middle,
        covariance=rows,
        map_error_m=map_error_units * abs(turn),
        alternatives=tuple(one for supposition in told for one in supposition.alternatives),
    )


def _surely_wrong(told: Sequence[Supposition]) -> frozenset[int]:
    """The points that nearly all suppositions call wrong."""
    suspected = frozenset[int]().union(*(one.wrong for one in told))
    return frozenset(at for at in suspected if sum(one.weight for one in told if at in one.wrong) >= SURE)


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


def _turn_sigma(spots: Complexes, sigmas: Floats) -> float:
    """One standard deviation, in radians, of how the pins turn the map: a vague one beside exact ones does no harm."""
    weights = sigmas**-2
    spread = float((weights * np.abs(spots - (weights * spots).sum() / weights.sum()) ** 2).sum())
    return math.inf if spread == 0 else 1 / math.sqrt(spread)


def _extent(points: Complexes) -> float:
    return float(np.abs(points[:, None] - points[None, :]).max())
