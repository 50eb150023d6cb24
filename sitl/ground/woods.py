"""A dense wood of tall crowns with gaps, glades and a track, lit by the sun, and whose branch is where.

The picture is shaded from the heights themselves, so that leaves, shadows and parallax belong together. Crowns are domes with
clumps of leaves of every size from metres to one cell, as canopies seen from above are self-similar.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from .noise import fractal
from .objects import SHADE, SUN
from .paint import strewn_grain, weather
from .parcels import wander
from .raster import SHIFT, Field, Image, fixed, fixed_length
from .shapes import DIRT, Colour, Points, Tree

CELL = 2  # pixels of the picture per cell of the heights: clumps of leaves are a few cells wide
OWNER_CELL = 8  # pixels of the picture per cell of the map of whose branch is where
APART = 4.8  # metres between trees, roughly
LOWEST, TALLEST = 9.0, 25.0  # metres of trees
RADIUS = 2.3, 4.2  # metres of crowns
FIRST_CROWN = 0.62  # height of a crown's rim as a share of its top
GLADES = 0.2  # share of the land without trees, the track aside
GLADE_CELL = 2.0  # metres per cell of the map of glades, which are 8 to 32 m wide
TRACK, VERGE = 3.4, 2.8  # metres: width of the track, and from its edge to the first stems
CLUMPS = 0.8  # metres: standard deviation of the heights of clumps
HOLES = 1.2  # standard deviations below which clumps let one see deep into the crown
DEEP = 2.5  # metres per standard deviation of such a hole
SOIL: Colour = (88, 124, 138)
GRASS: Colour = (84, 148, 130)
SAPLINGS, SAPLING_RADIUS = (4.0, 9.0), (1.4, 2.4)  # metres: heights and radii of what grows between trees
LOWEST_LEAVES = 1.0  # metres
TUFT_EVERY, LOG_EVERY = 2.0, 90.0  # square metres of open floor per tuft, stone or stump, and per fallen stem
TUFTS: tuple[Colour, ...] = ((48, 86, 78), (110, 172, 146), (132, 146, 150), (176, 196, 206), (46, 66, 70))
LOG: Colour = (150, 166, 176)
SHADOW_STEP, LONGEST_SHADOW = 0.6, 16.0  # metres of height at which the way to the sun is looked at
TINTS = np.array(
    [[58, 122, 88], [74, 132, 100], [60, 136, 108], [84, 128, 98]], np.float64
)  # BGR of four kinds of trees

Owners = NDArray[np.int32]


@dataclass(frozen=True, slots=True)
class Woods:
    """picture: (size, size, 3) BGR; heights: (size / CELL, size / CELL) metres; owner: (size / OWNER_CELL, ...) number of the
    nearest stem, from 1, also where no branch is."""

    picture: Image
    heights: Field
    owner: Owners


def raise_woods(seed: int, size: int, gsd: float) -> Woods:
    """A wood on a plane; gaps and glades show a tenth of the ground."""
    rng = np.random.default_rng([seed, 20])
    side, cells, cell = size * gsd, size // CELL, gsd * CELL
    track = wander(rng, side)
    trees = [one for one in stand(rng, side) if away_from(track, one) > TRACK / 2 + VERGE]
    heights, tree_at = crowns(rng, trees, cells, cell)
    rough = fractal(rng, cells, coarsest=16)
    clump(heights, rough, tree_at < 0)
    colours = floor(rng, track, cells, cell)
    leafy = tree_at >= 0
    colours[leafy] = np.array([one.tone for one in trees], np.uint8)[tree_at[leafy]]
    lit = shone_on(heights, cell)
    shaded = np.clip(colours * lit, 0, 255).astype(np.uint8)
    picture = np.asarray(cv2.resize(shaded, (size, size), interpolation=cv2.INTER_CUBIC), np.uint8)
    weather(picture, strewn_grain(rng, size, gsd))
    return Woods(picture, heights, owners(trees, size // OWNER_CELL, gsd * OWNER_CELL))


def paint_floor(seed: int, size: int, gsd: float) -> Image:
    """(size, size, 3) BGR: the floor of such a wood alone, evenly lit."""
    rng = np.random.default_rng([seed, 23])
    side = size * gsd
    ground = floor(rng, wander(rng, side), size // CELL, gsd * CELL)
    picture = np.asarray(cv2.resize(ground, (size, size), interpolation=cv2.INTER_CUBIC), np.uint8)
    weather(picture, strewn_grain(rng, size, gsd))
    return picture


def stand(rng: np.random.Generator, side: float) -> Iterator[Tree]:
    """Trees near the points of a grid, except in glades; neighbours are of similar height."""
    count, coarse = int(side / APART), max(4, int(side / GLADE_CELL))
    glade = fractal(rng, coarse, coarsest=16, finest=4)
    open_above, growth = np.quantile(glade, 1 - GLADES), fractal(rng, coarse, coarsest=32, finest=4)
    for place in np.stack(np.meshgrid(*[np.arange(count) + 0.5] * 2), axis=-1).reshape(-1, 2):
        x, y = (place + rng.normal(0, 0.22, 2)) * APART
        column, row = np.clip((np.array([x, y]) / side * coarse).astype(int), 0, coarse - 1)
        height = float(np.clip(15 + 3 * growth[row, column] + rng.normal(0, 1.7), LOWEST, TALLEST))
        if glade[row, column] < open_above:
            yield Tree(float(x), float(y), float(rng.uniform(*RADIUS)), height, tint(rng))
            x, y = (place + 0.5 + rng.normal(0, 0.22, 2)) * APART
            yield Tree(
                float(x), float(y), float(rng.uniform(*SAPLING_RADIUS)), float(rng.uniform(*SAPLINGS)), tint(rng)
            )


def tint(rng: np.random.Generator) -> Colour:
    """Crowns of a kind differ little, kinds a little more."""
    tone = TINTS[rng.choice(len(TINTS), p=(0.5, 0.25, 0.15, 0.1))] * rng.normal(1, 0.09) + rng.normal(0, 3, 3)
    b, g, r = (int(level) for level in np.clip(tone, 20, 200))
    return b, g, r


def away_from(line: Points, one: Tree) -> float:
    """Metres from a stem to the nearest point of a line (n, 2) of near points."""
    return float(np.hypot(line[:, 0] - one.x, line[:, 1] - one.y).min())


def crowns(rng: np.random.Generator, trees: list[Tree], cells: int, cell: float) -> tuple[Field, Owners]:
    """(cells, cells) metres of the highest leaves, 0 without any, and the index of their tree, -1 for none."""
    heights, tree_at = np.zeros((cells, cells), np.float32), np.full((cells, cells), -1, np.int32)
    ragged = [0.6 * fractal(rng, cells, coarsest=16, finest=2) for _ in range(2)]
    for number, one in enumerate(trees):
        low = np.clip(((np.array([one.x, one.y]) - 1.6 * one.radius) / cell).astype(int), 0, cells)
        high = np.clip(((np.array([one.x, one.y]) + 1.6 * one.radius) / cell).astype(int) + 1, 0, cells)
        part = slice(low[1], high[1]), slice(low[0], high[0])
        y, x = (np.mgrid[part] + 0.5) * cell
        away2 = ((x - one.x + ragged[0][part]) ** 2 + (y - one.y + ragged[1][part]) ** 2) / one.radius**2
        dome = one.height * (1 - (1 - FIRST_CROWN) * away2)
        above = (away2 < 1) & (dome > heights[part])
        heights[part][above], tree_at[part][above] = dome[above], number
    return heights, tree_at


def clump(heights: Field, rough: Field, bare: NDArray[np.bool_]) -> None:
    """Give crowns their clumps of leaves and the holes between them, in place. rough: of mean 0 and deviation 1."""
    leaves = heights + CLUMPS * rough - DEEP * np.clip(-rough - HOLES, 0, 1)
    heights[:] = np.where(bare, 0, np.clip(leaves, LOWEST_LEAVES, TALLEST))


def floor(rng: np.random.Generator, track: Points, cells: int, cell: float) -> Image:
    """(cells, cells, 3) BGR of the forest floor: litter and grass, the track, tufts, stones and fallen stems."""
    grass = np.clip(0.5 + 0.5 * fractal(rng, cells, coarsest=64), 0, 1)[..., None]
    ground = np.asarray(SOIL + grass * (np.array(GRASS, np.float32) - SOIL)).astype(np.uint8)
    for colour, width in ((DIRT.patch, TRACK), (DIRT.colour, TRACK / 2)):
        cv2.polylines(ground, [fixed(track, cell)], False, colour, max(1, round(width / cell)), cv2.LINE_AA, SHIFT)
    side = cells * cell
    for place in rng.random((int(side**2 / TUFT_EVERY), 2)) * side:
        (x, y), radius = fixed(place, cell).tolist(), float(np.clip(rng.gamma(2, 0.13), 0.1, 0.9))
        colour = TUFTS[int(rng.integers(len(TUFTS)))]
        cv2.circle(ground, (x, y), fixed_length(radius, cell), colour, -1, cv2.LINE_AA, SHIFT)
    for place in rng.random((int(side**2 / LOG_EVERY), 2)) * side:
        lying = rng.normal(0, 2, 2)
        ends = fixed(np.array([place - lying, place + lying]), cell)
        cv2.polylines(ground, [ends], False, LOG, max(1, round(0.3 / cell)), cv2.LINE_AA, SHIFT)
    return ground


def shone_on(heights: Field, cell: float) -> Field:
    """(n, n, 3): light on each cell relative to level ground in the sun, BGR."""
    smooth = cv2.GaussianBlur(heights, (0, 0), 1.0)
    slope_x, slope_y = (cv2.Sobel(smooth, cv2.CV_32F, *order, scale=1 / (8 * cell)) for order in ((1, 0), (0, 1)))
    facing = (1 + SUN[0] * slope_x + SUN[1] * slope_y) / np.sqrt(1 + slope_x**2 + slope_y**2)
    sunlit = np.clip(facing, 0, 1.4) * (1 - shadowed(heights, cell))
    around = cv2.GaussianBlur(heights, (0, 0), 2.0 / cell)
    sky = np.clip(0.85 + (heights - around) / 12, 0.5, 1.2)
    return np.asarray(sky[..., None] * SHADE + sunlit[..., None] * (1 - SHADE), np.float32)


def shadowed(heights: Field, cell: float) -> Field:
    """(n, n): share of the sun that leaves on the way to it take, 0 to 1."""
    dark = np.zeros_like(heights)
    for rise in np.arange(SHADOW_STEP, LONGEST_SHADOW, SHADOW_STEP):
        moved = np.array([[1, 0, SUN[0] * rise / cell], [0, 1, SUN[1] * rise / cell]])
        over = cv2.warpAffine(heights, moved, heights.shape[::-1], borderMode=cv2.BORDER_REPLICATE)
        np.maximum(dark, np.clip((over - heights - rise) / SHADOW_STEP, 0, 1), out=dark)
    return np.asarray(cv2.GaussianBlur(dark, (0, 0), 0.8), np.float32)


def owners(trees: list[Tree], cells: int, cell: float) -> Owners:
    """(cells, cells): number of the nearest stem, from 1."""
    elsewhere = np.ones((cells, cells), np.uint8)
    places = np.array([[one.x, one.y] for one in trees]).reshape(-1, 2) / cell
    column, row = np.clip(places.astype(int), 0, cells - 1).T
    elsewhere[row, column] = 0
    _, nearest = cv2.distanceTransformWithLabels(elsewhere, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)
    return np.asarray(nearest, np.int32)
