"""Rows of identical dormitory blocks: the same four wings around the same courtyard.

Blocks differ only in cars, bushes and stains on the roofs.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np

from .growth import tree
from .heights import standing
from .noise import fractal
from .objects import dim, draw_crowns, draw_roof, draw_shadows
from .raster import Field, Image, fixed
from .shapes import Building, Colour, Land, Points, Tree

PITCH = 48.0, 40.0  # metres between blocks along a street and across it
BLOCK = 36.0, 26.0  # outer metres of a block along and across
WING = 8.0  # metres of depth
STOREYS = 12.0  # metres of height
ROOF: Colour = (84, 92, 132)
MAKE = 13  # seed of the blocks' common appearance
BAYS = 14  # parking bays per block
PAINTS: tuple[Colour, ...] = ((210, 210, 210), (60, 56, 54), (60, 52, 150), (150, 104, 60))
ASPHALT: Colour = (116, 118, 120)
GRASS: Colour = (74, 112, 96)


@dataclass(frozen=True, slots=True, kw_only=True)
class Lives:
    """Differences between blocks: number of cars, bushes in the courtyard and trees along the street; alike, own: relative
    brightness per standard deviation of the stains common to all blocks, and of individual ones."""

    cars: int
    bushes: int
    trees: int
    alike: float
    own: float


QUARTER = Lives(cars=6, bushes=4, trees=3, alike=0.05, own=0.08)
BARRACKS = Lives(cars=4, bushes=2, trees=0, alike=0.08, own=0.025)


def raise_blocks(lives: Lives, seed: int, size: int, gsd: float) -> tuple[Image, Field]:
    """Picture (size, size, 3) BGR and heights in metres of a quarter."""
    rng = np.random.default_rng([seed, 13])
    land, corners = Land(size * gsd), block_corners(size * gsd)
    for corner in corners:
        land.buildings += wings(corner)
        land.trees += growth(rng, lives, corner)
    picture = np.empty((size, size, 3), np.uint8)
    picture[:] = ASPHALT
    for corner in corners:
        lay_lawns(picture, corner, gsd)
        park_cars(rng, lives.cars, picture, corner, gsd)
    dim(picture, draw_shadows(land, size, gsd))
    for building in land.buildings:
        draw_roof(picture, building, gsd)
    draw_crowns(rng, picture, land.trees, gsd)
    wear(rng, lives, picture, gsd)
    return picture, standing(land, size, gsd)


def block_corners(side: float) -> list[tuple[float, float]]:
    """North-west corners of all lots fully inside the world."""
    wide, deep = (np.arange(0, side - pitch, pitch) for pitch in PITCH)
    return [(float(x), float(y)) for y in deep for x in wide]


def wings(corner: tuple[float, float]) -> Iterator[Building]:
    """Two long wings and two short ones between them."""
    middle = np.array(corner) + np.array(PITCH) / 2
    for sign in (-1, 1):
        aside = np.array([0, sign * (BLOCK[1] - WING) / 2])
        yield Building(middle + aside, BLOCK[0], WING, 0.0, STOREYS, ROOF)
        along = np.array([sign * (BLOCK[0] - WING) / 2, 0])
        yield Building(middle + along, BLOCK[1] - 2 * WING, WING, np.pi / 2, STOREYS * 0.75, ROOF)


def lay_lawns(picture: Image, corner: tuple[float, float], gsd: float) -> None:
    """Grass around the block, a path through its courtyard, and small details, the same at every block."""
    rng = np.random.default_rng([MAKE, 1])
    middle = np.array(corner) + np.array(PITCH) / 2
    rectangle(picture, middle, (BLOCK[0] + 4, BLOCK[1] + 4), GRASS, gsd)
    rectangle(picture, middle, (BLOCK[0] - 2 * WING, 1.6), (150, 158, 164), gsd)
    for _ in range(6):
        place = middle + rng.uniform(-1, 1, 2) * (BLOCK[0] / 2 - WING - 1, BLOCK[1] / 2 - WING - 1)
        rectangle(picture, place, tuple(rng.uniform(0.8, 2.4, 2)), (int(rng.integers(60, 200)),) * 3, gsd)


def park_cars(rng: np.random.Generator, count: int, picture: Image, corner: tuple[float, float], gsd: float) -> None:
    """Park cars in some of the bays along the street."""
    for bay in rng.choice(BAYS, count, replace=False):
        place = np.array(corner) + np.array([6.0 + 2.7 * bay, 1.9])
        rectangle(picture, place, (1.8, 4.4), PAINTS[int(rng.integers(len(PAINTS)))], gsd)


def growth(rng: np.random.Generator, lives: Lives, corner: tuple[float, float]) -> Iterator[Tree]:
    """Bushes in the courtyard, trees along the street, at random positions."""
    middle = np.array(corner) + np.array(PITCH) / 2
    court = np.array([BLOCK[0] / 2 - WING - 1, BLOCK[1] / 2 - WING - 1])
    for place in rng.uniform(-1, 1, (lives.bushes, 2)) * court:
        yield tree(rng, middle + place, rng.uniform(0.6, 1.3))
    for along in rng.uniform(2, PITCH[0] - 2, lives.trees):
        yield tree(rng, np.array(corner) + np.array([along, 5.0]), rng.uniform(1.0, 2.2))


def rectangle(picture: Image, middle: Points, sides: tuple[float, ...], colour: Colour, gsd: float) -> None:
    half = np.array(sides) / 2
    corners = middle + half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    cv2.fillConvexPoly(picture, fixed(corners, gsd), colour, cv2.LINE_AA, 4)


def wear(rng: np.random.Generator, lives: Lives, picture: Image, gsd: float) -> None:
    """Add stains common to all lots, and individual ones, in place."""
    size = len(picture)
    wide, deep = (round(pitch / gsd) for pitch in PITCH)
    stains = fractal(np.random.default_rng([MAKE, 2]), 512, coarsest=64)[:deep, :wide]
    light = 1 + lives.alike * np.tile(stains, (size // deep + 1, size // wide + 1))[:size, :size]
    light += lives.own * fractal(rng, size, coarsest=64)
    picture[:] = np.clip(picture * light[..., None], 0, 255)
