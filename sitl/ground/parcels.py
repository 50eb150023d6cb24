"""Divides the land into fields by recursive halving, with a way along every cut."""

from __future__ import annotations

import numpy as np

from .shapes import CROPS, Land, Parcel, Points, Way, area

LARGEST_PARCEL = 8000.0  # square metres; small farms, so that every picture sees several fields
SMALLEST_PARCEL = 2500.0


def whole_square(side: float, turn: float) -> Points:
    """A rotated square that covers the world, so that no field edge is parallel to the raster."""
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * 0.72 * side
    cos, sin = np.cos(turn), np.sin(turn)
    return np.asarray(corners @ np.array([[cos, sin], [-sin, cos]]) + side / 2, np.float64)


def divide(rng: np.random.Generator, land: Land, corners: Points, depth: int = 0) -> None:
    """Halve a quadrilateral across its longer sides down to field size; every cut becomes a way."""
    if not touches(corners, land.side):
        return
    if area(corners) < rng.uniform(SMALLEST_PARCEL, LARGEST_PARCEL):
        land.parcels.append(sow(rng, corners))
        return
    a, b, c, d = longer_side_first(corners)
    share = rng.uniform(0.36, 0.64)
    start, end = a + share * (b - a), d + (share + rng.uniform(-0.06, 0.06)) * (c - d)
    land.ways.append(cut(rng, start, end, depth))
    divide(rng, land, np.array([a, start, end, d]), depth + 1)
    divide(rng, land, np.array([start, b, c, end]), depth + 1)


def longer_side_first(corners: Points) -> Points:
    sides = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
    return corners if sides[0] > sides[1] else np.roll(corners, -1, axis=0)


def touches(corners: Points, side: float) -> bool:
    low, high = corners.min(0), corners.max(0)
    return bool((high > 0).all() and (low < side).all())


def cut(rng: np.random.Generator, start: Points, end: Points, depth: int) -> Way:
    """The way along a cut: roads first, then mostly tracks, then grass strips."""
    if depth < 2 or (depth == 3 and rng.random() < 0.4):
        return Way(bent_line(rng, start, end, 0.8), rng.uniform(5.0, 6.5), "asphalt")
    if depth < 7 and rng.random() < 0.6:
        return Way(bent_line(rng, start, end, 1.5), rng.uniform(2.4, 3.4), "dirt")
    return Way(bent_line(rng, start, end, 0.6), rng.uniform(0.8, 2.4), "grass")


def bent_line(rng: np.random.Generator, start: Points, end: Points, amplitude: float) -> Points:
    """A slightly curved line, deviating by about `amplitude` metres, with fixed ends."""
    along = np.linspace(0, 1, 40)
    waves = np.sin(np.pi * np.outer(along, [1, 2, 3]))
    aside = waves @ rng.normal(0, amplitude, 3)
    direction = (end - start) / max(float(np.linalg.norm(end - start)), 1e-9)
    normal = np.array([-direction[1], direction[0]])
    return np.asarray(start + along[:, None] * (end - start) + np.outer(aside, normal), np.float64)


def sow(rng: np.random.Generator, corners: Points) -> Parcel:
    weights = np.array([crop.weight for crop in CROPS])
    crop = CROPS[int(rng.choice(len(CROPS), p=weights / weights.sum()))]
    edge = corners[1] - corners[0] if rng.random() < 0.5 else corners[2] - corners[1]
    return Parcel(corners, crop, float(np.arctan2(edge[1], edge[0])))


def wander(rng: np.random.Generator, side: float) -> Points:
    """A meandering line (160, 2) across the world."""
    along = np.linspace(-0.05, 1.05, 160)
    waves = np.sin(2 * np.pi * np.outer(along, np.arange(1, 9)) + rng.uniform(0, 6, 8))
    aside = rng.uniform(0.25, 0.75) + waves @ (rng.normal(0, 0.09, 8) / np.arange(1, 9))
    line = np.stack([along, aside], axis=1) * side
    return np.asarray(line if rng.random() < 0.5 else line[:, ::-1], np.float64)
