"""Populates the land: farmsteads, hedges, woods, lone trees, trees along the stream."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from .shapes import Building, Colour, Land, Points, Tree, area

FARM_EVERY = 60_000.0  # square metres of land per farmstead
HEDGE_SPACING = 7.0  # metres between the trees of a hedge
TREES_PER_HECTARE = 9.0  # lone trees only
ROOFS: tuple[Colour, ...] = (
    (62, 78, 150),
    (74, 84, 122),
    (118, 112, 108),
    (90, 92, 98),
    (160, 160, 156),
    (70, 96, 164),
)


def settle(rng: np.random.Generator, land: Land) -> None:
    """Farmsteads of a few buildings beside the roads."""
    roads = [way for way in land.ways if way.kind == "asphalt"]
    for _ in range(int(land.side**2 / FARM_EVERY)):
        road = roads[int(rng.integers(len(roads)))].points
        k = int(rng.integers(5, len(road) - 5))
        along = road[k + 1] - road[k - 1]
        heading = float(np.arctan2(along[1], along[0]))
        aside = np.array([-np.sin(heading), np.cos(heading)]) * rng.choice([-1, 1])
        land.buildings += farmstead(rng, road[k] + aside * 28, heading)


def farmstead(rng: np.random.Generator, centre: Points, heading: float) -> Iterator[Building]:
    """Two to five buildings around a yard, aligned with the road."""
    axes = np.array([[np.cos(heading), np.sin(heading)], [-np.sin(heading), np.cos(heading)]])
    places = np.array([[-14, 6], [14, 4], [0, -9], [-19, -12], [22, -13]], np.float64)
    for place in rng.permutation(places)[: int(rng.integers(2, 6))]:
        length, width, height = rng.uniform((9, 6.5, 3.5), (22, 11, 7.5))
        quarter = np.pi / 2 * int(rng.integers(2))
        roof = ROOFS[int(rng.integers(len(ROOFS)))]
        yield Building(centre + place @ axes, length, width, heading + quarter, height, roof)


def tree(rng: np.random.Generator, place: Points, radius: float) -> Tree:
    tone = np.array([46, 80, 64]) * rng.uniform(0.75, 1.3) + rng.normal(0, 7, 3) + np.array([0, 8, 18]) * rng.random()
    b, g, r = (int(v) for v in np.clip(tone, 15, 150))
    return Tree(float(place[0]), float(place[1]), radius, radius * rng.uniform(1.6, 2.4), (b, g, r))


def hedges(rng: np.random.Generator, land: Land) -> Iterator[Tree]:
    """Trees and bushes along some of the ways, with gaps."""
    for way in land.ways:
        if way.kind == "stream" or rng.random() < 0.55:
            continue
        run = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(way.points, axis=0), axis=1))])
        for at in np.arange(0, run[-1], HEDGE_SPACING):
            if rng.random() < 0.6:
                place = np.array([np.interp(at, run, way.points[:, axis]) for axis in (0, 1)])
                aside = (way.width / 2 + 1.5) * rng.choice([-1, 1])
                yield tree(rng, place + aside + rng.normal(0, 0.8, 2), rng.gamma(4, 0.45) + 0.5)


def woods(rng: np.random.Generator, land: Land) -> Iterator[Tree]:
    """Fill every wood parcel with trees."""
    for parcel in (parcel for parcel in land.parcels if parcel.crop.name == "wood"):
        a, b, c, d = parcel.corners
        for u, v in rng.random((int(area(parcel.corners) / 14), 2)):
            yield tree(rng, (a + u * (b - a)) * (1 - v) + (d + u * (c - d)) * v, rng.gamma(8, 0.33) + 0.8)


def lone_trees(rng: np.random.Generator, land: Land) -> Iterator[Tree]:
    for place in rng.random((int(land.side**2 / 10_000 * TREES_PER_HECTARE), 2)) * land.side:
        yield tree(rng, place, rng.gamma(2, 0.6) + 0.3)


def bank_trees(rng: np.random.Generator, land: Land) -> Iterator[Tree]:
    """Dense trees along the stream."""
    for way in (way for way in land.ways if way.kind == "stream"):
        for point in np.repeat(way.points, 3, axis=0):
            yield tree(rng, point + rng.normal(0, 3.5, 2), rng.gamma(4, 0.4) + 0.5)
