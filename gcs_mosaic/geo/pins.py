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
from gcs_mosaic.geo.far_pins import far_from_most
from gcs_mosaic.geo.gross_errors import UNUSUAL, Supposition, suppositions, usual_squares
from gcs_mosaic.geo.points import USUAL_SIGMA_M, Pin, Points, coordinates, plane_of, points_of

__all__ = ["UNUSUAL", "USUAL_SIGMA_M", "Pin", "PinnedMap", "Refused", "anchored_by_pins", "misfit_of"]

APART_SIGMAS = 10.0  # of two pins: nearer ones turn the map by more than 8 degrees of one standard deviation
FEWEST_TOGETHER = 4  # points that agree, at least, beside which one that is far off is left out
MISFIT_SIGMAS = 3.0  # a pin further from where the map lays it does not fit
POINTED_UNITS = 2.0  # how exactly people point at a place, one standard deviation in canvas units
SAME_SCALE = 0.1
CONTRADICTING = 1.25  # times the usual sum of squares: beyond it points are not believed to be as exact as is said
RATHER = 2 / 3  # of all that is likely: halves that contradict each other have one half of it each
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
    """The anchor that pins tell; `map_error_units`: what the map may be bent by, one standard deviation in canvas units.

    Where all together tell nothing, those whose coordinates are far from those of most are left out if enough others agree.
    """
    of_all = _anchored(pins, map_error_units)
    far = {} if isinstance(of_all, PinnedMap) and of_all.fits else far_from_most(pins)
    if not far or _names_others(of_all, [pins[at].name for at in far]):
        return of_all
    found = _anchored([pin for at, pin in enumerate(pins) if at not in far], map_error_units)
    agrees = isinstance(found, PinnedMap) and (found.fits or bool(found.misfits))
    if isinstance(found, Refused) or not agrees or found.points - len(found.misfits) < FEWEST_TOGETHER:
        names = [pins[at].name for at in far]
        return Refused(_far_words(names, min(far.values()))) if isinstance(of_all, Refused) else of_all
    near = iter(found.residuals_m)
    residuals = tuple(far[at] if at in far else next(near) for at in range(len(pins)))
    misfits = (*found.misfits, *dict.fromkeys(pins[at].name for at in far))
    count = found.points + len(far)
    return replace(found, residuals_m=residuals, fits=False, checked=False, points=count, misfits=misfits)


def _names_others(found: PinnedMap | Refused, far: Sequence[str]) -> bool:
    """Whether others than the far ones are what does not fit: then those may be of a flight that goes far."""
    return isinstance(found, PinnedMap) and bool(found.misfits) and not set(far) & set(found.misfits)


def _far_words(names: Sequence[str], metres: float) -> str:
    told, km = list(dict.fromkeys(names)), f"{metres / 1000:.0f}"
    of_what = "further than any flight: look for latitude and longitude exchanged, or a sign"
    if len(told) == 1:
        return f"{told[0]} lies {km} km from the other pins, {of_what}, or delete it."
    return f"{', '.join(told)} lie {km} km from the other pins, {of_what}, or delete them."


def _anchored(pins: Sequence[Pin], map_error_units: float) -> PinnedMap | Refused:
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
    anchor, told = _laid(points, plane, map_error_units)
    if not GSD_M[0] <= abs(anchor.turn) <= GSD_M[1]:
        return Refused(_absurd(anchor.turn))
    residuals = tuple(map(float, np.abs(anchor.turn * places + anchor.shift - spots)))
    return _judged(anchor, residuals, points, told)


def _laid(points: Points, plane: LocalPlane, map_error_units: float) -> tuple[Anchor, list[Supposition]]:
    turn, _ = similarity(points.places, points.spots, points.sigmas**-2)
    anchor, told = _with_units_of(abs(turn), points, plane, map_error_units)
    if abs(abs(anchor.turn) / abs(turn) - 1) > SAME_SCALE:  # wrong points had taken it along
        return _with_units_of(abs(anchor.turn), points, plane, map_error_units)
    return anchor, told


def _with_units_of(
    metres: float, points: Points, plane: LocalPlane, map_error_units: float
) -> tuple[Anchor, list[Supposition]]:
    """Canvas units of so many metres tell how exact the points' places are."""
    others = np.hypot(points.scatter, math.hypot(map_error_units, POINTED_UNITS)) * metres
    told = suppositions(points.places, points.spots, points.sigmas, others, points.supposed)
    return _no_better_than_its_points(_anchor(plane, told, map_error_units), points, told), told


def _judged(anchor: Anchor, residuals: tuple[float, ...], points: Points, told: Sequence[Supposition]) -> PinnedMap:
    count = len(points.names)
    undecided = told[0].weight < SURE and _contradict(anchor, points, _kept(told, points))
    wrong = frozenset[int]() if undecided else _surely_wrong(told)
    all_right = next((one for one in told if not one.wrong), None)
    weight = 0.0 if all_right is None else all_right.weight
    sigmas = _sigmas(anchor, points)
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


def _no_better_than_its_points(anchor: Anchor, points: Points, told: Sequence[Supposition]) -> Anchor:
    """Where even the points that are not called wrong contradict each other their errors are none that average out: the map lies
    nowhere better than it does at one of them."""
    kept = _kept(told, points)
    if not _contradict(anchor, points, kept):
        return anchor
    missed = np.abs(anchor.turn * points.places[kept] + anchor.shift - points.spots[kept])
    of_one = WITHIN_95 * math.sqrt(float((missed**2).mean()) / 2)
    return replace(anchor, least_error_m=min(float(missed.max()), of_one))


def _kept(told: Sequence[Supposition], points: Points) -> list[int]:
    wrong = _wrong(told, RATHER)
    return [at for at in range(len(points.names)) if at not in wrong]


def _contradict(anchor: Anchor, points: Points, kept: list[int]) -> bool:
    if len(kept) <= 2:
        return False
    return _squares(_missed(points.places[kept], points.spots[kept], _sigmas(anchor, points)[kept])) > CONTRADICTING


def _sigmas(anchor: Anchor, points: Points) -> Floats:
    """Of where each point is laid, as is said of it, of pointing and of the map; metres in each direction."""
    return np.hypot(points.sigmas, np.hypot(POINTED_UNITS * abs(anchor.turn), anchor.map_error_m))


def _surely_wrong(told: Sequence[Supposition]) -> frozenset[int]:
    """The points that nearly all suppositions call wrong."""
    return _wrong(told, SURE)


def _wrong(told: Sequence[Supposition], share: float) -> frozenset[int]:
    """The points that so much of what is likely calls wrong."""
    suspected = frozenset[int]().union(*(one.wrong for one in told))
    return frozenset(at for at in suspected if sum(one.weight for one in told if at in one.wrong) >= share)


def misfit_of(places: Complexes, spots: Complexes, sigmas: Floats) -> float:
    """How badly the pins fit: above 1 they are not believed, by the worst of them or by all together."""
    if len(places) <= 2:
        return 0.0
    missed = _missed(places, spots, sigmas)
    return float(max(missed.max() / MISFIT_SIGMAS, _squares(missed)))


def _missed(places: Complexes, spots: Complexes, sigmas: Floats) -> Floats:
    """By how many standard deviations the points miss the similarity that fits them best."""
    turn, shift = similarity(places, spots, sigmas**-2)
    missed: Floats = np.abs(turn * places + shift - spots) / sigmas
    return missed


def _squares(missed: Floats) -> float:
    """Their sum, of three points or more, in what is usual."""
    return float((missed**2).sum()) / usual_squares(2 * len(missed) - 4)


def _turn_sigma(spots: Complexes, sigmas: Floats) -> float:
    """One standard deviation, in radians, of how the pins turn the map: a vague one beside exact ones does no harm."""
    weights = sigmas**-2
    spread = float((weights * np.abs(spots - (weights * spots).sum() / weights.sum()) ** 2).sum())
    return math.inf if spread == 0 else 1 / math.sqrt(spread)


def _extent(points: Complexes) -> float:
    return float(np.abs(points[:, None] - points[None, :]).max())
