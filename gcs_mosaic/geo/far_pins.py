"""Pins whose coordinates are no flight's distance from those of most: exchanged latitude and longitude, or a sign."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gcs_mosaic.geo.ellipsoid import Floats, ecef
from gcs_mosaic.geo.points import Pin, coordinates

NEAR_M = 10e3
"""From each other are coordinates of most flights. One of five pins within 300 m that is off by 20 km is found by its residual;
one that is off by 30 km or more takes the scale along with which residuals are judged."""


def distances_m(pins: Sequence[Pin]) -> Floats:
    """(n, n): between the coordinates of pins, straight through the earth, metres."""
    places = ecef(coordinates(pins))
    distances: Floats = np.linalg.norm(places[:, None] - places[None, :], axis=-1)
    return distances


def far_from_most(pins: Sequence[Pin]) -> dict[int, float]:
    """By their places in the list the pins that are far from the others, and how far (metres) at least; empty where none is, or
    no majority of them is together."""
    apart = distances_m(pins)
    if not np.isfinite(apart).all():
        return {}
    near = apart <= NEAR_M
    together = near[int(near.sum(axis=1).argmax())] if len(pins) else np.zeros(0, bool)
    if 2 * together.sum() <= len(pins):
        return {}
    return {int(at): float(apart[at, together].min()) for at in np.flatnonzero(~together)}
