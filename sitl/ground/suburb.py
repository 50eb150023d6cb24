"""A suburb: varied houses side by side, with gardens and tall trees between them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from .growth import ROOFS, tree
from .heights import standing
from .land import lay_out
from .paint import paint
from .raster import Field, Image
from .shapes import Building, Land, Points, Tree

LOT = 19.0  # metres between houses
TREES_PER_LOT = 1.6


def raise_suburb(seed: int, size: int, gsd: float) -> tuple[Image, Field]:
    """Picture (size, size, 3) BGR and heights in metres."""
    rng = np.random.default_rng([seed, 14])
    land = lay_out(seed, size * gsd)
    land.buildings += houses(rng, land)
    land.trees += gardens(rng, land.side)
    return paint(land, seed, size, gsd), standing(land, size, gsd)


def houses(rng: np.random.Generator, land: Land) -> Iterator[Building]:
    """A house on most lots, at one of two perpendicular headings, clear of the roads."""
    roads = np.concatenate([np.full((1, 2), np.inf), *(way.points for way in land.ways if way.kind == "asphalt")])
    for place in lots(rng, land.side):
        if rng.random() < 0.85 and np.linalg.norm(roads - place, axis=1).min() > 13:
            length, width, height = rng.uniform((8, 7, 4.5), (15, 10, 10))
            turn = 0.3 + np.pi / 2 * int(rng.integers(2)) + rng.normal(0, 0.05)
            yield Building(place, length, width, turn, height, ROOFS[int(rng.integers(len(ROOFS)))])


def gardens(rng: np.random.Generator, side: float) -> Iterator[Tree]:
    for place in lots(rng, side):
        for _ in range(rng.poisson(TREES_PER_LOT)):
            one = tree(rng, place + rng.uniform(-LOT / 2, LOT / 2, 2), rng.gamma(5, 0.4) + 0.5)
            yield Tree(one.x, one.y, one.radius, one.height * 1.5, one.tone)


def lots(rng: np.random.Generator, side: float) -> Iterator[Points]:
    """Centres of lots, on a jittered lattice."""
    for y in np.arange(LOT / 2, side, LOT):
        for x in np.arange(LOT / 2, side, LOT):
            yield np.array([x, y]) + rng.normal(0, 1.5, 2)
