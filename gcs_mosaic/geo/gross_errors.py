"""What coordinates of distinct points tell of how a map lies, when some of them may be wrong by far.

Each supposition (which points are wrong, and by how much all of them miss in addition) gives a similarity by least squares and a
weight by Bayes' rule: the marginal likelihood of a linear model whose wrong points have a large variance. What is stated is what
all suppositions together tell. So an error that residuals cannot show (two points, or one far from all others) is not taken for
absent. Suppositions of several wrong points are found in two ways: greedily, from the best ones of one fewer, and as what is left
beside points that agree, which trimmed least squares find from every two of them (Rousseeuw and Van Driessen 2006, "Computing LTS
regression for large data sets"): many points that are wrong in one way hide each other from a search that takes one at a time.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from gcs_mosaic.geo.anchor import Alternative, Complexes
from gcs_mosaic.geo.ellipsoid import Floats

# Of a coordinate that is wrong (another feature, an exchanged digit, another datum): per axis, with how often.
GROSS_M = ((45.0, 0.97), (300.0, 0.025), (3000.0, 0.005))
NONE_WRONG = 0.5  # before anything is compared: of two points, which check nothing, one is as likely wrong as not
FURTHER_WRONG = 0.1  # for each wrong one another
AS_STATED = 0.15  # how often the stated deviations are right; else points miss by some more, of any size
MISSED_M = np.geomspace(0.02, 30.0, 24)
MISSED_BY_FAR_M, BY_FAR = np.geomspace(60.0, 3000.0, 6), 1e-4  # points most of which are wrong agree in nothing
MOST_LOOKED_AT = 24  # points that may be wrong, at each step: of many those that miss most
ALL_PAIRS = 12  # points; of so many each two may be wrong together
MOST_WRONG = 12
LEAST_AGREEING = 3  # points; of two nothing tells whether they agree
MOST_PAIRS = 800  # from which agreeing points are sought: all of 40 points, some of more
STEPS = 4  # of least squares to the points that miss least; the third changes little
BEST_KEPT = 6  # sets of agreeing points of each size
ABOUT_AS_MANY = 0.1  # of the points that agree: so many fewer of others are as many
AGREEING = 1.5  # times the usual sum of squares
UNUSUAL = 2.75  # standard deviations of a normal distribution: 99.7 % are below
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
    found |= _as_likely(model, found)
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
    yield from _one_by_one(model)
    beside = list(_beside_agreeing(model))
    yield from beside
    best = max(beside, key=model.likelihood, default=frozenset[int]())
    for _ in range(MOST_WRONG):
        near = [best ^ {one} for one in model.suspects(best) + model.nearest(best)]
        near = [wrong for wrong in near if len(model.places) - len(wrong) >= LEAST_AGREEING]
        yield from near
        before, best = best, max([best, *near], key=model.likelihood)
        if best == before:
            break
    if len(best) >= LEAST_AGREEING:
        yield frozenset(range(len(model.places))) - best


def _one_by_one(model: _Model) -> Iterator[Set]:
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


def _beside_agreeing(model: _Model) -> Iterator[Set]:
    """What is left beside points that agree: of few points beside sets of each size, of many beside half of them or more, up to
    where the others begin to miss by much more."""
    count = len(model.places)
    few = count <= ALL_PAIRS
    for kept in range(LEAST_AGREEING, count) if few else (count // 2,):
        for missed in model.trimmed(kept):
            order = np.argsort(missed)
            leaps = missed[order[kept:]] / np.maximum(missed[order[kept - 1 : -1]], 1e-3)
            for at in (kept,) if few else kept + np.argsort(-leaps)[:BEST_KEPT]:
                yield frozenset(order[at:].tolist())


def _as_likely(model: _Model, found: Mapping[Set, Fits]) -> dict[Set, Fits]:
    """The fits of sets of agreeing points that are as many as those of the likeliest one, and others: which of two halves is the
    tighter, or the wider spread, says nothing of which is right, so they are made as likely."""
    best = max(found, key=model.likelihood)
    every = frozenset(range(len(model.places)))
    fewer = int(ABOUT_AS_MANY * len(every - best))
    told = {}
    for wrong, fits in found.items():
        others = every - wrong
        as_many = len(others) >= max(len(every - best) - fewer, LEAST_AGREEING)
        if as_many and len(others - best) <= 1 + fewer and model.agree(others):
            told[wrong] = fits.copy()
            told[wrong][:, 0] += model.likelihood(best) - model.likelihood(wrong)
    return told


class _Model:
    """The marginal likelihoods of one set of points. `missed`: (m,) metres, in addition; the first is that nothing is missed."""

    def __init__(self, places: Complexes, spots: Complexes, sigmas: Floats, others: Floats, supposed: Floats) -> None:
        self.places, self._spots = places, spots
        self._known: dict[Set, Fits] = {}
        missed = np.concatenate([[0.0], MISSED_M, MISSED_BY_FAR_M])[:, None]
        known = np.where(supposed, 0.0, sigmas**2) + others**2
        self._variances = missed**2 + known  # (m, n)
        self._variances[0] = sigmas**2 + others**2
        shares = (AS_STATED, 1), (1 - AS_STATED - BY_FAR, len(MISSED_M)), (BY_FAR, len(MISSED_BY_FAR_M))
        self._prior = np.log(np.concatenate([np.full(count, share / count) for share, count in shares]))

    def suspects(self, wrong: Set) -> list[int]:
        """The points besides the wrong ones; of many those that miss most."""
        rest = self._besides(wrong)
        missed = self._missed(rest)
        return sorted(rest, key=lambda one: -missed[one])[:MOST_LOOKED_AT]

    def nearest(self, wrong: Set) -> list[int]:
        """The wrong points; of many those that miss least."""
        missed = self._missed(self._besides(wrong))
        return sorted(wrong, key=lambda one: missed[one])[:MOST_LOOKED_AT]

    def _besides(self, wrong: Set) -> list[int]:
        return [one for one in range(len(self.places)) if one not in wrong]

    def _missed(self, right: list[int]) -> Floats:
        """By how much all points miss what some of them tell, metres."""
        weights = np.zeros(len(self.places))
        weights[right] = 1 / self._variances[0][right]
        missed: Floats = np.abs(_fitted(self.places, self._spots, weights[None])[0][0])
        return missed

    def trimmed(self, kept: int) -> list[Floats]:
        """By how many standard deviations each point misses the similarities that so many agree in best, the best one first."""
        sigmas, pairs = np.sqrt(self._variances[0]), _pairs(len(self.places))
        rows = np.zeros((len(pairs), len(sigmas)))
        np.put_along_axis(rows, pairs, 1.0, axis=1)
        for _ in range(STEPS):
            with np.errstate(divide="ignore", invalid="ignore"):  # of points at one place
                missed = np.abs(_fitted(self.places, self._spots, rows / sigmas**2)[0]) / sigmas
            missed = missed[np.isfinite(missed).all(axis=1)]
            order = np.argsort(missed, axis=1)[:, :kept]
            rows = np.zeros(missed.shape)
            np.put_along_axis(rows, order, 1.0, axis=1)
        _, first = np.unique(rows, axis=0, return_index=True)
        squares = (np.take_along_axis(missed, order, axis=1) ** 2).sum(axis=1)
        return [missed[at] for at in first[np.argsort(squares[first])][:BEST_KEPT]]

    def agree(self, points: Set) -> bool:
        """Whether they fit each other, by about what is said of them."""
        right = sorted(points)
        squares = self._missed(right)[right] ** 2 / self._variances[0][right]
        return bool(squares.sum() <= AGREEING * usual_squares(2 * len(right) - 4))

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


def _pairs(count: int) -> npt.NDArray[np.int64]:
    """(k, 2): every two of so many points, or an even choice of them."""
    pairs = np.stack(np.triu_indices(count, 1), axis=1)
    return pairs[:: -(-len(pairs) // MOST_PAIRS)]


def _before(wrong: int, count: int) -> float:
    """How likely so many wrong ones are, in log, each set of them the same."""
    if not wrong:
        return math.log(NONE_WRONG)
    sets = math.lgamma(count + 1) - math.lgamma(wrong + 1) - math.lgamma(count - wrong + 1)
    return math.log((1 - NONE_WRONG) * (1 - FURTHER_WRONG)) + (wrong - 1) * math.log(FURTHER_WRONG) - sets


def usual_squares(freedom: int) -> float:
    """What a sum of squares of so many degrees of freedom hardly ever exceeds (Wilson and Hilferty 1931)."""
    spread = 2 / (9 * freedom)
    return freedom * (1 - spread + UNUSUAL * math.sqrt(spread)) ** 3
