"""Lays out a countryside, determined by the seed alone."""

from __future__ import annotations

import numpy as np

from .growth import bank_trees, hedges, lone_trees, settle, woods
from .parcels import divide, wander, whole_square
from .shapes import Land, Way


def lay_out(seed: int, side: float) -> Land:
    """A square of `side` metres with fields, a stream, a track, farmsteads and trees."""
    rng = np.random.default_rng([seed, 1])
    land = Land(side)
    divide(rng, land, whole_square(side, turn=rng.uniform(0.15, 0.5)))
    land.ways.append(Way(wander(rng, side), 3.5, "stream"))
    land.ways.append(Way(wander(rng, side), 2.6, "dirt"))
    settle(rng, land)
    land.trees += [*hedges(rng, land), *woods(rng, land), *lone_trees(rng, land), *bank_trees(rng, land)]
    return land
