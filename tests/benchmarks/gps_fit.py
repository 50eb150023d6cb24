"""How well islands agree with the positions that cameras wrote into their frames (EXIF GPS); only ever to judge a map by.

A consumer GPS is good to 2-5 m, and the middle of a tilted frame lies off the aircraft by height x tan(tilt): this finds
wrong joins, bends and mirrored maps, not pixels.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Complex = NDArray[np.complex128]  # places in the plane, x + iy, y up
LatLon = tuple[float, float]  # degrees

FEWEST = 3  # frames of an island to which a similarity leaves something over
FEWEST_MIRRORED = 5  # frames from which on a mirrored map is told from chance
ROUNDS = 50
LEAST_SPREAD_M = 5.0  # what a GPS is off anyway is no outlier


@dataclass(frozen=True, slots=True)
class IslandFit:
    """An island laid over its GPS positions by one similarity: what remains, in metres."""

    frames: int
    rms_m: float
    mirrored: bool


def fits(entries: Iterable[Mapping[str, Any]], positions: Mapping[str, LatLon]) -> list[IslandFit]:
    """A fit for every island with enough positions; entries as in placements.json, positions by frame name."""
    islands: dict[int, list[tuple[complex, LatLon]]] = {}
    for entry in entries:
        if entry["name"] in positions:
            islands.setdefault(entry["island"], []).append((_middle(entry), positions[entry["name"]]))
    return [
        island_fit(np.array([place for place, _ in frames]), metres([position for _, position in frames]))
        for frames in islands.values()
        if len(frames) >= FEWEST
    ]


def island_fit(places: Complex, positions_m: Complex) -> IslandFit:
    """Places (n,) on the canvas, y up, against positions (n,) in metres."""
    off = remaining(places, positions_m)
    mirrored = len(places) >= FEWEST_MIRRORED and bool(
        np.median(remaining(np.conj(places), positions_m)) < np.median(off) / 2
    )
    return IslandFit(len(places), float(np.sqrt((off**2).mean())), mirrored)


def remaining(source: Complex, target: Complex) -> NDArray[np.float64]:
    """Distances (n,) that a similarity leaves which is fitted without regard to the few that are far off."""
    weights, off = np.ones(len(source)), np.zeros(len(source))
    for _ in range(ROUNDS):
        off = np.abs(_laid(source, target, weights) - target)
        weights = 1 / (1 + (off / max(LEAST_SPREAD_M, float(np.median(off)))) ** 2)
    return off


def _laid(source: Complex, target: Complex, weights: NDArray[np.float64]) -> Complex:
    """The source after the similarity, without reflection, that is best by weighted least squares."""
    share = weights / weights.sum()
    from_middle, to_middle = (share * source).sum(), (share * target).sum()
    spread = max(float((share * np.abs(source - from_middle) ** 2).sum()), 1e-12)
    turn = (share * np.conj(source - from_middle) * (target - to_middle)).sum() / spread
    return np.asarray(turn * (source - from_middle) + to_middle)


def metres(positions: Iterable[LatLon]) -> Complex:
    """Positions (n,) east + i north of their mean, in metres: good for the size of a flight."""
    degrees = np.array(list(positions), dtype=np.float64)
    north, east = (degrees - degrees.mean(axis=0)).T
    narrower = math.cos(math.radians(float(degrees[:, 0].mean())))
    return np.asarray(east * 111_320 * narrower + 1j * north * 110_574)


def _middle(entry: Mapping[str, Any]) -> complex:
    """Where the middle of a frame lies on the canvas, y up."""
    middle = [(entry["width"] - 1) / 2, (entry["height"] - 1) / 2, 1.0]
    x, y, depth = np.asarray(entry["canvas_from_frame"], dtype=np.float64) @ middle
    return complex(x / depth, -y / depth)
