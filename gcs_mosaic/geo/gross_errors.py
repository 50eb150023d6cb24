"""What coordinates of distinct points tell of how a map lies, when some of them may be wrong by far.

Each supposition (which points are wrong, and by how much all of them miss in addition) gives a similarity by least squares and a
weight by Bayes' rule: the marginal likelihood of a linear model whose wrong points have a large variance. What is stated is what
all suppositions together tell. So an error that residuals cannot show (two points, or one far from all others) is not taken for
absent. Suppositions of several wrong points are found greedily, from the best ones of one fewer.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from gcs_mosaic.geo.anchor import Alternative, Complexes
from gcs_mosaic.geo.ellipsoid import Floats

# Of a coordinate that is wrong (another feature, an exchanged digit, another datum): per axis, with how often.
GROSS_M = ((45.0, 0.97), (300.0, 0.025), (3000.0, 0.005))
NONE_WRONG = 0.5  # before anything is compared: of two points, which check nothing, one is as likely wrong as not
FURTHER_WRONG = 0.1  # for each wrong one another
AS_STATED = 0.15  # how often the stated deviations are right; else points miss by some more, of any size
MISSED_M = np.geomspace(0.02, 30.0, 24)
MOST_LOOKED_AT = 24  # points that may be wrong, at each step: of many those that miss most
ALL_PAIRS = 12  # points; of so many each two may be wrong together
MOST_WRONG = 12
HOPELESS = 12.0  # in log likelihood: what is so much worse than the best is not followed further
LEAST_WEIGHT = 1e-5

Set = frozenset[int]
# (k, 6): log likelihood, turn, shift, middle, and the variances per axis of the turn and of where the middle lies.
Fits = Complexes


@dataclass(frozen=True, slots=True)
class Supposition:
    """Points that are wrong, and the similarities that follow, with their weights."""

    wrong: Set
    alternatives: tuple[Alternative, ...]

    @property
    def weight(self) -> float:
        return sum(one.weight for one in self.alternatives)


def suppositions(
    places: Complexes, spots: Complexes, sigmas: Floats, others: Floats, supposed: Floats
) -> list[Supposition]:
    """The likely ones, the best first; their weights add up to one.

    `sigmas`: of each coordinate in each direction, metres; where they are only `supposed` the residuals may overrule them to both
    sides. `others`: of what else is known to be off, as the map's bend.
    """
    model = _Model(places, spots, sigmas, others, supposed)
    found = {wrong: model.fits(wrong) for wrong in _followed(model)}
    best = max(float(fits[:, 0].real.max()) for fits in found.values())
    total = sum(float(np.exp(fits[:, 0].real - best).sum()) for fits in found.values())
    told = [Supposition(wrong, tuple(_alternatives(fits, best, total))) for wrong, fits in found.items()]
    return sorted((one for one in told if one.alternatives), key=lambda one: -one.weight)


def _alternatives(fits: Fits, best: float, total: float) -> Iterator[Alternative]:
    weights = np.exp(fits[:, 0].real - best) / total
    for at in np.flatnonzero(weights > LEAST_WEIGHT):
        turn, shift, middle, of_turn, of_middle = fits[at, 1:].tolist()
        yield Alternative(float(weights[at]), turn, shift, middle, of_turn.real, of_middle.real)


def _followed(model: _Model) -> Iterator[Set]:
    """Sets of wrong points that are looked at."""
    yield frozenset()
    count, best, overall = len(model.places), frozenset[int](), model.likelihood(frozenset())
    for step in range(1, min(max((count - 2) // 2, 1), MOST_WRONG) + 1):
        children: Iterable[Set] = [best | {one} for one in model.suspects(best)]
        if step == 2 and count <= ALL_PAIRS:
            children = map(frozenset, itertools.combinations(range(count), 2))
        likely = {wrong: model.likelihood(wrong) for wrong in children}
        yield from likely
        best = max(likely, key=likely.__getitem__)
        if likely[best] < overall - HOPELESS:
            return
        overall = max(overall, likely[best])


class _Model:
    """The marginal likelihoods of one set of points. `missed`: (m,) metres, in addition; the first is that nothing is missed."""

    def __init__(self, places: Complexes, spots: Complexes, sigmas: Floats, others: Floats, supposed: Floats) -> None:
        self.places, self._spots = places, spots
        self._known: dict[Set, Fits] = {}
        missed = np.concatenate([[0.0], MISSED_M])[:, None]
        known = np.where(supposed, 0.0, sigmas**2) + others**2
        self._variances = missed**2 + known  # (m, n)
        self._variances[0] = sigmas**2 + others**2
        self._prior = np.log(np.concatenate([[AS_STATED], np.full(len(MISSED_M), (1 - AS_STATED) / len(MISSED_M))]))

    def suspects(self, wrong: Set) -> list[int]:
        """The points besides the wrong ones; of many those that miss most."""
        rest = [one for one in range(len(self.places)) if one not in wrong]
        weights = np.zeros(len(self.places))
        weights[rest] = 1 / self._variances[0][rest]
        missed = np.abs(_fitted(self.places, self._spots, weights[None])[0][0])
        return sorted(rest, key=lambda one: -missed[one])[:MOST_LOOKED_AT]

    def likelihood(self, wrong: Set) -> float:
        """In log, with what is likely before."""
        logs = self.fits(wrong)[:, 0].real
        return float(logs.max() + np.log(np.exp(logs - logs.max()).sum()))

    def fits(self, wrong: Set) -> Fits:
        """One for each size of a gross error and of what all points miss."""
        if wrong not in self._known:
            self._known[wrong] = self._fits(sorted(wrong))
        return self._known[wrong]

    def _fits(self, at: list[int]) -> Fits:
        count = len(self.places)
        gross = np.array(GROSS_M if at else ((0.0, 1.0),))
        variances = np.repeat(self._variances[None], len(gross), axis=0)  # (g, m, n)
        variances[:, :, at] += gross[:, :1, None] ** 2
        variances = variances.reshape(-1, count)
        left, weight, middle, apart, turn, shift = _fitted(self.places, self._spots, 1 / variances)
        logs = -np.log(variances).sum(axis=1) - np.log(weight * apart) - (np.abs(left) ** 2 / variances).sum(axis=1) / 2
        logs += (np.log(gross[:, 1:]) + self._prior).ravel() + _before(len(at), count)
        return np.stack([logs, turn, shift, middle, 1 / apart, 1 / weight], axis=1)


def _fitted(places: Complexes, spots: Complexes, weights: Floats) -> tuple[Any, ...]:
    """Of similarities by least squares, one for each row of weights (m, n): residuals (m, n), sum of the weights, middle, sum of
    the weighted squares around it, turn, shift (each m)."""
    weight = weights.sum(axis=1)
    # Sums instead of products of matrices, whose threads cost more than such small ones.
    middle, target = ((weights * one).sum(axis=1) / weight for one in (places, spots))
    away = places - middle[:, None]
    apart = (weights * np.abs(away) ** 2).sum(axis=1)
    turn = (weights * np.conj(away) * (spots - target[:, None])).sum(axis=1) / apart
    left = turn[:, None] * away + target[:, None] - spots
    return left, weight, middle, apart, turn, target - turn * middle


def _before(wrong: int, count: int) -> float:
    """How likely so many wrong ones are, in log, each set of them the same."""
    share = NONE_WRONG if not wrong else (1 - NONE_WRONG) * (1 - FURTHER_WRONG) * FURTHER_WRONG ** (wrong - 1)
    return math.log(share / math.comb(count, wrong))
