"""An anchor by the positions that the aircraft told with its triggers; only where somebody has asked for it.

Errors of a receiver wander within a minute or so and do not average out, so residuals of 2 m go with corners that are 7 m off;
and a position is told some time after or before the shutter opened. So the lag is found along the flight's own motion, and the
stated error is that of errors which keep for `WANDERS_S`. Where they do not, it is too large.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gcs_mosaic.geo.anchor import GSD_M, WITHIN_95, Anchor, Complexes, as_complex, joined, similarity
from gcs_mosaic.geo.ellipsoid import FURTHEST_M, Floats, LocalPlane
from gcs_mosaic.geo.pins import Refused

LEAST_SHOTS = 8
LEAST_SIGMA_M = 3.0  # of a receiver without corrections: a good fit alone does not prove a better one
WANDERS_S = 60.0  # errors this far apart in time have e times less to do with each other
EXTENT_SIGMAS = 5.0  # the shots' least RMS radius
MOST_OUTLIERS = 0.35
OUTLIER_SIGMAS = 4.0
LONGEST_LAG_S = 3.0
LAG_STEP_S = 0.05
COARSE = 5  # steps of a first look
LAG_SIGMA_S = (
    1.0  # of what is known before: so that a straight line, where a lag is no different from a shift, tells its error
)
SCALES_DIFFER = 0.05  # of the halves; or three standard deviations, if that is more
CAUCHY = (
    2.385  # standard deviations: 95 % as efficient as least squares where nothing is wrong (Holland and Welsch 1977)
)
SAMPLES = 300  # random pairs to begin with: all of them hit an outlier with a probability of 1e-70 at 35 %
ROUNDS = 30
GAP = 4.0  # times the usual interval between shots: across it nothing is known of the path
MOST_IN_COVARIANCE = 200  # shots, evenly taken: their matrix of correlations is dense
LEAST_ERROR_SIGMAS = 1.5  # no half axis is stated to be less
MEDIAN_OF_RAYLEIGH = 1.17741


@dataclass(frozen=True, slots=True)
class ShotPosition:
    """A shot: when (seconds of any clock), the camera's own place over the canvas, and what the aircraft told (degrees)."""

    time_s: float
    x: float
    y: float
    longitude_deg: float
    latitude_deg: float


@dataclass(frozen=True, slots=True)
class PositionedMap:
    """An anchor; `lag_s`: how long after the shutter a position is measured; `sigma_m`: of one of them, in each direction."""

    anchor: Anchor
    lag_s: float
    sigma_m: float
    residual_m: float  # median
    shots: int
    outliers: int


@dataclass(frozen=True, slots=True)
class _Flown:
    times: Floats
    places: Complexes
    spots: Complexes
    trusted: Floats  # 0 where the path before or after is not known, else 1

    def part(self, chosen: Any) -> _Flown:
        return _Flown(self.times[chosen], self.places[chosen], self.spots[chosen], self.trusted[chosen])


@dataclass(frozen=True, slots=True)
class _Fit:
    turn: complex
    shift: complex
    weights: Floats
    cost: float
    missed: Floats  # metres


def anchored_by_positions(shots: Sequence[ShotPosition], map_error_units: float = 0.0) -> PositionedMap | Refused:
    """The anchor that positions tell; `map_error_units`: what the map may be bent by, one standard deviation in canvas units."""
    if len(shots) < LEAST_SHOTS:
        return Refused(
            f"{len(shots)} frames of this island have a position, and {LEAST_SHOTS} are needed: fly on, or set pins."
        )
    plane = _plane(shots)
    flown = _flown(plane, shots)
    if len(flown.times) < LEAST_SHOTS:
        return Refused(f"The {len(shots)} positions tell {len(flown.times)} different times alone: set pins instead.")
    if not np.isfinite(flown.spots).all() or np.abs(flown.spots).max() > FURTHEST_M / 2:
        return Refused("The positions are further apart than any flight: set pins instead.")
    lag, fit = _with_lag(flown)
    sigma = max(_sigma(fit, flown), LEAST_SIGMA_M)
    refused = _refused(flown, lag, fit, sigma)
    if refused is not None:
        return refused
    sigma, anchor = _anchor(plane, flown, lag, fit)
    anchor = replace(anchor, map_error_m=map_error_units * abs(fit.turn))
    refused = _halves_disagree(plane, flown, lag)
    if refused is not None:
        return refused
    outliers = int((fit.missed > OUTLIER_SIGMAS * sigma).sum())
    return PositionedMap(anchor, lag, sigma, float(np.median(fit.missed)), len(shots), outliers)


def _plane(shots: Sequence[ShotPosition]) -> LocalPlane:
    """At the median position; longitudes may lie on both sides of 180 degrees."""
    first = shots[0].longitude_deg
    east = [(shot.longitude_deg - first + 180) % 360 - 180 for shot in shots]
    return LocalPlane(first + float(np.median(east)), float(np.median([shot.latitude_deg for shot in shots])))


def _flown(plane: LocalPlane, shots: Sequence[ShotPosition]) -> _Flown:
    """In the order of time; of shots at the same moment the first."""
    ordered = sorted(shots, key=lambda shot: shot.time_s)
    times, kept = np.unique([shot.time_s for shot in ordered], return_index=True)
    places = joined(np.array([[shot.x, shot.y] for shot in ordered], np.float64)[kept])
    told = np.array([[shot.longitude_deg, shot.latitude_deg] for shot in ordered])[kept]
    gaps = np.diff(times)
    is_gap = gaps > GAP * np.median(gaps) if len(gaps) else np.zeros(0, bool)
    unknown = np.concatenate([is_gap, [False]]) | np.concatenate([[False], is_gap])
    return _Flown(times, places, as_complex(plane.spots(told)), np.where(unknown, 0.0, 1.0))


def _with_lag(flown: _Flown) -> tuple[float, _Fit]:
    """The lag that fits best, and the fit with it."""
    first = _consensus(flown.places, flown.spots)
    scale = max(CAUCHY * float(np.median(first)) / MEDIAN_OF_RAYLEIGH, 0.5)
    weights = 1 / (1 + (first / scale) ** 2)
    steps = round(LONGEST_LAG_S / LAG_STEP_S)
    coarse = [_fit(flown, at * LAG_STEP_S, weights, scale) for at in range(-steps, steps + 1, COARSE)]
    best = min(coarse, key=lambda fit: fit.cost)
    # With the best lag the residuals are smaller, and tell what is an outlier.
    scale = max(CAUCHY * float(np.median(best.missed)) / MEDIAN_OF_RAYLEIGH, 0.5)
    costs: dict[int, float] = {}
    for step in (COARSE, 1):
        middle = min(costs, key=costs.__getitem__, default=0)
        reach = COARSE if costs else steps
        for at in range(max(middle - reach, -steps), min(middle + reach, steps) + 1, step):
            lag = at * LAG_STEP_S
            costs[at] = _fit(flown, lag, best.weights, scale).cost + 0.5 * (lag / LAG_SIGMA_S) ** 2
    lag = _lowest(costs)
    return lag, _fit(flown, lag, best.weights, scale)


def _fit(flown: _Flown, lag: float, weights: Floats, scale: float) -> _Fit:
    """Cauchy-weighted least squares with a given lag."""
    places = _moved(flown, lag)
    for _ in range(ROUNDS):
        turn, shift = similarity(places, flown.spots, weights * _used(flown))
        missed = np.abs(turn * places + shift - flown.spots)
        before, weights = weights, 1 / (1 + (missed / scale) ** 2)
        if np.abs(weights - before).max() < 1e-3:
            break
    cost = float((_used(flown) * np.log1p((missed / scale) ** 2)).sum()) * CAUCHY**2 / 2
    return _Fit(turn, shift, weights, cost, missed)


def _consensus(places: Complexes, spots: Complexes) -> Floats:
    """The distances that remain with the similarity of two shots which has the least median (Rousseeuw 1984)."""
    chance = np.random.default_rng(0)
    best, least = np.full(len(places), np.inf), math.inf
    for _ in range(SAMPLES):
        one, other = chance.choice(len(places), 2, replace=False)
        if abs(places[one] - places[other]) < 1e-6:
            continue
        turn = (spots[one] - spots[other]) / (places[one] - places[other])
        missed = np.abs(turn * (places - places[one]) + spots[one] - spots)
        if (median := float(np.median(missed))) < least:
            best, least = missed, median
    return best


def _moved(flown: _Flown, lag: float) -> Complexes:
    """Where the camera was `lag` seconds after each shot, along straight lines between shots."""
    velocities = np.diff(flown.places) / np.diff(flown.times)
    at = np.clip(np.searchsorted(flown.times, flown.times + lag, side="right") - 1, 0, len(velocities) - 1)
    moved: Complexes = flown.places[at] + velocities[at] * (flown.times + lag - flown.times[at])
    return np.where(flown.trusted > 0, moved, flown.places)


def _used(flown: _Flown) -> Floats:
    """Shots beside a gap are left out where enough others are there."""
    return flown.trusted if flown.trusted.sum() >= LEAST_SHOTS else np.ones_like(flown.trusted)


def _lowest(costs: Mapping[int, float]) -> float:
    """Seconds: the lowest point of a parabola through the least of the costs (by steps of lag) and its neighbours."""
    at = min(costs, key=costs.__getitem__)
    if at - 1 not in costs or at + 1 not in costs:
        return at * LAG_STEP_S
    before, lowest, after = costs[at - 1], costs[at], costs[at + 1]
    bend = before - 2 * lowest + after
    return LAG_STEP_S * (at + ((before - after) / (2 * bend) if bend > 0 else 0.0))


def _sigma(fit: _Fit, flown: _Flown) -> float:
    """One standard deviation in each direction of what remains."""
    used = fit.missed[_used(flown) > 0]
    return float(np.median(used)) / MEDIAN_OF_RAYLEIGH


def _refused(flown: _Flown, lag: float, fit: _Fit, sigma: float) -> Refused | None:
    radius = float(np.sqrt(np.mean(np.abs(flown.spots - np.median(flown.spots)) ** 2)))
    outliers = float((fit.missed > OUTLIER_SIGMAS * sigma).mean())
    if not GSD_M[0] <= abs(fit.turn) <= GSD_M[1]:
        return Refused(
            f"By its positions a pixel of the map would be {abs(fit.turn):.3g} m, which is not believed: set pins."
        )
    if radius < EXTENT_SIGMAS * sigma:
        return Refused(f"The positions lie within {radius:.0f} m, with errors of {sigma:.0f} m: fly on, or set pins.")
    if outliers > MOST_OUTLIERS:
        return Refused(f"{outliers:.0%} of the positions do not fit the map: set pins instead.")
    if abs(lag) > LONGEST_LAG_S - LAG_STEP_S:
        return Refused(f"The positions are {LONGEST_LAG_S:.0f} s or more off from the frames: set pins instead.")
    return None


def _anchor(plane: LocalPlane, flown: _Flown, lag: float, fit: _Fit) -> tuple[float, Anchor]:
    """Sigma (metres) of a position, and the anchor with its covariance."""
    spread, shrunk, freedom = _uncertainty(flown, lag, fit)
    measured = _sigma(fit, flown) / shrunk
    sigma = max(measured, LEAST_SIGMA_M)
    # Of few independent errors the deviation itself is uncertain: the radius is that of Student's distribution.
    believed = max(measured * math.sqrt(freedom * (0.05 ** (-2 / freedom) - 1)) / WITHIN_95, LEAST_SIGMA_M)
    middle = _middle(flown, lag, fit)
    rows = tuple(tuple(map(float, row)) for row in spread * believed**2)
    anchor = Anchor(
        plane=plane,
        turn=fit.turn,
        shift=fit.shift,
        middle=middle,
        covariance=rows,
        least_error_m=LEAST_ERROR_SIGMAS * sigma,
    )
    return sigma, anchor


def _middle(flown: _Flown, lag: float, fit: _Fit) -> complex:
    weights = fit.weights * _used(flown)
    return complex((weights * _moved(flown, lag)).sum() / weights.sum())


def _uncertainty(flown: _Flown, lag: float, fit: _Fit) -> tuple[Floats, float, float]:
    """Of errors with a deviation of 1 m that wander: the covariance (4, 4) of `Anchor`, how much of them remains to be seen, and
    how many independent errors that is (Satterthwaite 1946).
    """
    step = max(1, math.ceil(len(flown.times) / MOST_IN_COVARIANCE))
    weights = (fit.weights * _used(flown))[::step]
    places = _moved(flown, lag)[::step] - _middle(flown, lag, fit)
    drift = (fit.turn * (_moved(flown, lag + LAG_STEP_S) - _moved(flown, lag - LAG_STEP_S)) / (2 * LAG_STEP_S))[::step]
    one, none = np.ones(len(places)), np.zeros(len(places))
    design = np.block(
        [
            [np.stack([places.real, -places.imag, one, none, drift.real], axis=1)],
            [np.stack([places.imag, places.real, none, one, drift.imag], axis=1)],
        ]
    )
    times = flown.times[::step]
    alike = np.kron(np.eye(2), np.exp(-np.abs(times[:, None] - times[None, :]) / WANDERS_S))
    known = np.zeros((5, 5))
    known[4, 4] = (LEAST_SIGMA_M / LAG_SIGMA_S) ** -2 if not drift.any() else LAG_SIGMA_S**-2
    weight = np.concatenate([weights, weights])
    back = np.linalg.solve(design.T @ (weight[:, None] * design) + known, (weight[:, None] * design).T)
    spread = back @ alike @ back.T + _of_known(design, weight, known)
    left = np.eye(len(weight)) - design @ back
    root = np.sqrt(weight / weight.sum())
    seen = (root[:, None] * left) @ alike @ (root[:, None] * left).T
    shrunk = max(math.sqrt(max(float(np.trace(seen)), 0.0)), 0.25)
    return spread[:4, :4], shrunk, float(np.trace(seen) ** 2 / (seen**2).sum())


def _of_known(design: Floats, weight: Floats, known: Floats) -> Floats:
    """What is known before is uncertain too."""
    inverse = np.linalg.inv(design.T @ (weight[:, None] * design) + known)
    spread: Floats = inverse @ known @ inverse
    return spread


def _halves_disagree(plane: LocalPlane, flown: _Flown, lag: float) -> Refused | None:
    """Whether each half of the flight alone lays the map elsewhere than its stated error allows."""
    half = len(flown.times) // 2
    if half < LEAST_SHOTS:
        return None
    parts = [flown.part(slice(None, half)), flown.part(slice(half, None))]
    anchors = []
    for part in parts:
        missed = _consensus(part.places, part.spots)
        scale = max(CAUCHY * float(np.median(missed)) / MEDIAN_OF_RAYLEIGH, 0.5)
        fit = _fit(part, lag, 1 / (1 + (missed / scale) ** 2), scale)
        anchors.append(_anchor(plane, part, lag, fit)[1])
    one, other = anchors
    for place in _corners(flown.places):
        apart = abs((one.turn - other.turn) * place + one.shift - other.shift)
        allowed = math.hypot(*(anchor.error(place.real, -place.imag).major_m for anchor in anchors))
        if apart > 1.5 * allowed:
            return Refused(
                f"The flight's two halves lay the map {apart:.0f} m apart, and {allowed:.0f} m would be usual: "
                "its positions are not to be trusted; set pins instead."
            )
    ratio = abs(math.log(one.metres_per_unit / other.metres_per_unit))
    usual = 3 * math.hypot(*(math.sqrt(anchor.covariance[0][0]) / anchor.metres_per_unit for anchor in anchors))
    if ratio > max(SCALES_DIFFER, usual):
        return Refused(f"The flight's two halves tell sizes that differ by {ratio:.0%}: set pins instead.")
    return None


def _corners(places: Complexes) -> list[complex]:
    easts, norths = (places.real.min(), places.real.max()), (places.imag.min(), places.imag.max())
    return [complex(east, north) for east in easts for north in norths]
