"""Whether the positions that were told of the shots fit the map better if every picture belongs some shots later. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Complexes: TypeAlias = NDArray[np.complex128]

MOST_SHIFT = 2
LEAST = 8  # shots; a similarity fits few ones anyhow
_BETTER = 0.5  # of what remains, in favour of a shift: positions lag by a part of the time between two shots themselves
_LEAST_M = 1.0  # what remains must be more, or positions are too good to tell


def shift_by_positions(told: Sequence[tuple[float, float] | None], places: Sequence[complex | None]) -> int | None:
    """By how many shots later each picture belongs by the positions, 0: as it is; None: they cannot tell.

    `told`: latitude and longitude in degrees of each shot, in order; `places`: where the map has its picture, x + iy with y down,
    in any unit. On a straight line at a constant speed every shift fits alike.
    """
    spots = _spots(told)
    there = np.array([np.nan if place is None else place for place in places], np.complex128)
    remains = {shift: _remains(spots, there, shift) for shift in range(-MOST_SHIFT, MOST_SHIFT + 1)}
    known = {shift: left for shift, left in remains.items() if left is not None}
    if 0 not in known or len(known) < 2:
        return None
    best = min(known, key=lambda shift: (known[shift], abs(shift)))
    others = min(left for shift, left in known.items() if shift != best)
    clear = known[best] < _BETTER * others and others > _LEAST_M
    return best if clear else None


def _spots(told: Sequence[tuple[float, float] | None]) -> Complexes:
    """Metres east and, as y goes down, south."""
    degrees = np.array([(np.nan, np.nan) if one is None else one for one in told], np.float64).reshape(-1, 2)
    if np.isnan(degrees).all():
        return np.full(len(degrees), np.nan, np.complex128)
    north, east = np.nanmedian(degrees, axis=0)
    metre = 111_320.0
    spots: Complexes = (degrees[:, 1] - east) * metre * np.cos(np.radians(north)) - 1j * (degrees[:, 0] - north) * metre
    return spots


def _remains(spots: Complexes, places: Complexes, shift: int) -> float | None:
    """Median distance in metres after one similarity, if picture k belongs to shot k + `shift`; None for too few."""
    later = np.full_like(spots, np.nan)
    if abs(shift) >= len(spots):
        return None
    if shift >= 0:
        later[: len(spots) - shift] = spots[shift:]
    else:
        later[-shift:] = spots[:shift]
    known = ~(np.isnan(later) | np.isnan(places))
    if known.sum() < LEAST:
        return None
    spot, place = later[known], places[known]
    for _ in range(3):  # again without what lies far off
        mean, middle = spot.mean(), place.mean()
        spread = (np.abs(place - middle) ** 2).sum()
        if spread == 0:
            return None
        turn = ((place - middle).conj() * (spot - mean)).sum() / spread
        missed = np.abs(spot - mean - turn * (place - middle))
        near = missed <= 3 * np.median(missed) + 1e-9
        if near.sum() >= LEAST:
            spot, place = spot[near], place[near]
    return float(np.median(missed))
