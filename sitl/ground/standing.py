"""Open country with things that stand up, apart from each other: houses, walls, masts and trees."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from .growth import ROOFS, tree
from .heights import standing
from .land import lay_out
from .paint import paint
from .raster import Field, Image
from .shapes import Building, Land, Points, Tree

Kind = Literal["house", "wall", "mast", "tree"]
KINDS: tuple[Kind, ...] = ("house", "wall", "mast", "tree")
APART = 22.0  # metres between things
NARROW = 1.2  # metres: three cells of the height map, which smooths what is narrower away
CONCRETE, RUST = (150, 158, 162), (58, 76, 128)


@dataclass(frozen=True, slots=True)
class Standing:
    """A thing by its outline (n, 2) in metres from the north-west corner of the world: as wide as it is anywhere at its height
    `shoulder` and below, and at its top."""

    kind: Kind
    foot: Points
    shoulder: float
    top: Points
    height: float


def raise_standing(seed: int, size: int, gsd: float) -> tuple[Image, Field]:
    """Picture (size, size, 3) BGR and heights in metres."""
    land = with_things(seed, size * gsd)
    return paint(land, seed, size, gsd), standing(land, size, gsd)


def things(seed: int, side: float) -> list[Standing]:
    """What stands on the ground of this seed."""
    land = with_things(seed, side)
    return [*map(_of_building, land.buildings), *map(_of_tree, land.trees)]


def with_things(seed: int, side: float) -> Land:
    """The countryside of this seed with these things in place of its own."""
    land = lay_out(seed, side)
    made = list(_made(np.random.default_rng([seed, 21]), side))
    buildings = [one for one in made if isinstance(one, Building)]
    return replace(land, buildings=buildings, trees=[one for one in made if isinstance(one, Tree)])


def _made(rng: np.random.Generator, side: float) -> Iterator[Building | Tree]:
    for y in np.arange(APART / 2, side, APART):
        for x in np.arange(APART / 2, side, APART):
            place, kind, turn = np.array([x, y]) + rng.normal(0, 2, 2), rng.integers(len(KINDS)), rng.uniform(0, np.pi)
            if KINDS[kind] == "house":
                length, width, height = rng.uniform((7, 6, 3.5), (12, 9, 8))
                yield Building(place, length, width, turn, height, ROOFS[int(rng.integers(len(ROOFS)))])
            elif KINDS[kind] == "wall":
                yield Building(place, rng.uniform(6, 14), NARROW, turn, rng.uniform(2, 4), CONCRETE)
            elif KINDS[kind] == "mast":
                yield Building(place, NARROW, NARROW, turn, rng.uniform(8, 14), RUST)
            else:
                one = tree(rng, place, rng.uniform(1.5, 4))
                yield replace(one, height=rng.uniform(5, 11))


def _of_building(one: Building) -> Standing:
    corners, _ = one.outline()
    kind: Kind = "house" if one.width > NARROW else "mast" if one.length == NARROW else "wall"
    return Standing(kind, corners, one.height, corners, one.height)


def _of_tree(one: Tree) -> Standing:
    angle = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1) * one.radius
    middle = np.array([one.x, one.y])
    return Standing("tree", middle + circle, 0.55 * one.height, middle + 0.45 * circle, one.height)
