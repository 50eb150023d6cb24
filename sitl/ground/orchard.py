"""Tall trees on a plane: an orchard of near-identical trees on a grid, and a forest canopy of individual ones."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from .growth import tree
from .heights import standing
from .noise import fractal
from .objects import dim, draw_crowns, draw_shadows
from .paint import strewn_grain, weather
from .raster import Field, Image
from .shapes import Colour, Land, Tree

GRID = 8.0, 6.5  # metres between rows, and between trees
TURN = 0.3  # radians; rotation of the grid, the same in every orchard
MAKE, MAKES = 11, 3  # seed of the trees' appearance, and number of variants
LEAVES: Colour = (44, 84, 62)
MEADOW: Colour = (78, 122, 108)
TALLEST = 9.0, 12.0  # metres of orchard trees
APART = 4.6  # approximate metres between the trees of a wood
LITTER: Colour = (52, 76, 72)


def raise_orchard(seed: int, size: int, gsd: float) -> tuple[Image, Field]:
    """Picture (size, size, 3) BGR and heights in metres of an orchard; places differ only in small details."""
    rng = np.random.default_rng([seed, 11])
    land = Land(size * gsd)
    land.trees += orchard_trees(rng, land.side)
    picture = lawn(rng, size, MEADOW, grain=0.03)
    dim(picture, draw_shadows(land, size, gsd))
    for k, one in zip(rng.integers(MAKES, size=len(land.trees)), land.trees, strict=True):
        draw_crowns(np.random.default_rng([MAKE, int(k)]), picture, [one], gsd)
    weather(picture, strewn_grain(rng, size, gsd) // 4)
    return picture, standing(land, size, gsd)


def orchard_trees(rng: np.random.Generator, side: float) -> Iterator[Tree]:
    """One tree in forty is missing; the others deviate from the grid by 0.15 m (standard deviation)."""
    reach = round(side / min(GRID))
    cos, sin = np.cos(TURN), np.sin(TURN)
    for row in range(-reach, reach):
        for place in range(-reach, reach):
            u, v = row * GRID[0] + rng.normal(0, 0.15), place * GRID[1] + rng.normal(0, 0.15)
            x, y = side / 2 + u * cos - v * sin, side / 2 + u * sin + v * cos
            radius, height, light = rng.normal(2.5, 0.12), rng.uniform(*TALLEST), rng.normal(1, 0.05)
            if rng.random() > 0.025 and max(abs(x - side / 2), abs(y - side / 2)) < side / 2:
                b, g, r = (int(c * light) for c in LEAVES)
                yield Tree(x, y, radius, height, (b, g, r))


def raise_canopy(seed: int, size: int, gsd: float) -> tuple[Image, Field]:
    """Picture (size, size, 3) BGR and heights in metres of a wood with a few clearings."""
    rng = np.random.default_rng([seed, 12])
    land = Land(size * gsd)
    land.trees += sorted(wood_trees(rng, land.side), key=lambda one: one.height)
    picture = lawn(rng, size, LITTER, grain=0.08)
    dim(picture, draw_shadows(land, size, gsd))
    draw_crowns(rng, picture, land.trees, gsd)
    weather(picture, strewn_grain(rng, size, gsd))
    return picture, standing(land, size, gsd)


def wood_trees(rng: np.random.Generator, side: float) -> Iterator[Tree]:
    """Trees of 6 to 16 m, except in clearings."""
    count = int(side / APART)
    clearing = fractal(rng, 64, coarsest=16) > 1.1
    for row in range(count):
        for column in range(count):
            place = (np.array([column, row]) + 0.5 + rng.normal(0, 0.28, 2)) * APART
            cell = np.clip((place / side * 64).astype(int), 0, 63)
            if not clearing[cell[1], cell[0]]:
                one = tree(rng, place, rng.uniform(1.6, 3.4))
                yield Tree(one.x, one.y, one.radius, 3.5 * one.radius + rng.uniform(0, 4), one.tone)


def lawn(rng: np.random.Generator, size: int, colour: Colour, grain: float) -> Image:
    """(size, size, 3) of one colour; `grain` is the relative brightness per standard deviation of the noise."""
    light = 1 + grain * fractal(rng, size, coarsest=64)
    return np.clip(np.asarray(colour, np.float32) * light[..., None], 0, 255).astype(np.uint8)
