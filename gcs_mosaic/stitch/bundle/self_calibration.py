"""How far the matches of an adjustment determine its lenses, if their errors are not independent.

The cost takes every match for a measurement of its own, so many frames seem to determine a lens that flat ground seen straight
down does not: relief, a rolling shutter and wrong matches pull, frame by frame, all matches of a frame one way. The covariance
that comes about is that of the cost's slopes summed by frame, between the two sides of the inverse normal matrix: the
cluster-robust or sandwich estimate (Huber 1967; Liang and Zeger, Biometrika 73(1), 1986). A pair belongs to both its frames
(Aronow, Samii and Assenova, Political Analysis 23(4), 2015); their sums over frames alone are taken, which state too much rather
than too little. What all frames have in common shows in no residuals: effects that the lens model leaves out are considered, not
estimated (consider covariance: Bierman, Factorization Methods for Discrete Sequential Estimation, 1977, chapter 8).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from gcs_mosaic.stitch.arrays import Array, LensesNx5, Matrices, Matrix, PairValues
from gcs_mosaic.stitch.bundle.elimination import BLOCK
from gcs_mosaic.stitch.bundle.normal_equations import ENDS, PLACES, Normal, Run, solve
from gcs_mosaic.stitch.bundle.problem import Problem
from gcs_mosaic.stitch.camera.projection import LENS_TERMS


@dataclass(frozen=True, slots=True)
class Slopes:
    """Slopes of the cost of p pairs: `of_matches` (p, COLUMNS), and what effects outside the model add, (p, COLUMNS, e)."""

    of_matches: Matrix
    of_effects: Array


@dataclass(frozen=True, slots=True)
class LensEvidence:
    """What the matches say of each of c lenses, poses and other lenses left free.

    `directions` (c, 5, 5): in columns, combinations of the terms as multiples of their prior deviations, in which the matches'
    information is diagonal; `information` (c, 5): by direction, relative to the prior's, as the cost has it; `doubt` (c, 5): the
    variance of the cost's slope over that information, 1 if errors are as the cost expects, and never less; `unmodelled`
    (c, 5, 5): the covariance of the slope by effects that the lens model leaves out.
    """

    sigma: LensesNx5
    directions: Matrices
    information: Matrix
    doubt: Matrix
    unmodelled: Matrices

    @property
    def prior_weights(self) -> Matrices:
        """(c, 5, 5) inverse covariances of priors that hold against the cost as the given ones against independent matches."""
        return self._along(self.doubt)

    @property
    def of_matches(self) -> Matrices:
        """(c, 5, 5) information of the matches on the terms, as the cost has it."""
        return self._along(self.information)

    def covariance(self, weights: Matrices, spread: LensesNx5) -> Matrices:
        """Covariances (c, 5, 5) of lenses adjusted with priors of these weights (c, 5, 5).

        The prior's mean is off as well: by `spread` (c, 5), standard deviations of lenses about it.
        """
        of_prior = weights * (spread**2)[:, None, :] @ weights
        pulls = self._along(self.information * self.doubt) + self.unmodelled + of_prior
        inverse = np.linalg.inv(self.of_matches + weights)
        return np.asarray(inverse @ pulls @ inverse)

    def _along(self, values: Matrix) -> Matrices:
        """Matrices (c, 5, 5) of the terms with these values (c, 5) in the directions."""
        scaled = self.directions / self.sigma[:, :, None]
        return np.asarray(scaled * values[:, None, :] @ scaled.transpose(0, 2, 1))


def lens_evidence(
    problem: Problem, normal: Normal, slopes: Iterable[Slopes], residuals: PairValues, sigma: LensesNx5, run: Run = map
) -> LensEvidence | None:
    """Evidence at the end of an adjustment with free lenses and priors `problem.lens_weights`; None if its matrix is singular.

    `slopes` of batches of pairs, in order; `residuals` (p, k): relative to the loss scale, NaN without a match;
    `sigma` (c, 5): the priors' deviations.
    """
    assert problem.lens_weights is not None, "the first state fills them in"
    columns = _columns_of_inverse(normal, run)
    if columns is None:
        return None
    own = normal.layout.lenses
    marginal = np.linalg.inv(columns[own, :LENS_TERMS, np.arange(len(own))])
    pulls = _pulls(problem, normal, columns, slopes)
    scores, unmodelled = (marginal @ np.einsum("fci,fcj->cij", some, some) @ marginal for some in pulls)
    of_matches = (marginal - problem.lens_weights) * _stiffness(residuals)
    scale = sigma[:, :, None] * sigma[:, None, :]
    information, directions = np.linalg.eigh(_symmetric(of_matches * scale))
    information = np.maximum(information, LEAST_INFORMATION)
    variance = np.einsum("cik,cij,cjk->ck", directions, scores * scale, directions)
    return LensEvidence(sigma, directions, information, np.maximum(variance / information, 1.0), unmodelled)


LEAST_INFORMATION = 1e-6  # relative to the prior's: none, whatever rounding makes of it


def _columns_of_inverse(normal: Normal, run: Run) -> Array | None:
    """Columns (v, BLOCK, c, 5) of the inverse normal matrix that belong to the lenses' terms."""
    columns = np.empty((normal.layout.vertices, BLOCK, len(normal.layout.lenses), LENS_TERMS))
    for number, lens in enumerate(normal.layout.lenses.tolist()):
        for term in range(LENS_TERMS):
            unit = np.zeros(columns.shape[:2])
            unit[lens, term] = -1
            found = solve(normal, unit, 0.0, run)
            if found is None:
                return None
            columns[:, :, number, term] = found
    return columns


def _pulls(problem: Problem, normal: Normal, columns: Array, slopes: Iterable[Slopes]) -> tuple[Array, Array]:
    """How far the matches of each frame move the lenses, (n, c, 5), and each effect that the model leaves out, (e, c, 5)."""
    layout, first = normal.layout, 0
    padded = np.concatenate([columns, np.zeros_like(columns[:1])])  # the last is of vertex -1, what is fixed
    lenses = layout.lenses[problem.camera]
    of_frames = np.zeros((len(problem.poses), *columns.shape[2:]))
    of_effects: Array | float = 0.0
    for some in slopes:
        pairs = problem.pairs[first : first + len(some.of_matches)]
        first += len(pairs)
        ends = padded[np.concatenate([layout.frames[pairs], lenses[pairs]], axis=1)]
        by_slope = ends.reshape(len(pairs), ENDS * BLOCK, *columns.shape[2:])[:, PLACES]
        of_pair = np.einsum("psck,ps->pck", by_slope, some.of_matches)
        for side in (0, 1):
            np.add.at(of_frames, pairs[:, side], of_pair)
        of_effects = of_effects + np.einsum("psck,pse->eck", by_slope, some.of_effects)
    return of_frames, np.asarray(of_effects)


def _stiffness(residuals: PairValues) -> float:
    """Curvature of the Cauchy cost relative to that of its weights alone, which make up the normal matrix."""
    size2 = residuals[np.isfinite(residuals)] ** 2
    weight = 1 / (1 + size2)
    return max(float((weight - size2 * weight**2).mean() / weight.mean()), LEAST_STIFFNESS) if len(size2) else 1.0


LEAST_STIFFNESS = 0.1  # more wrong than right matches; clean ones have 0.75


def _symmetric(matrices: Matrices) -> Matrices:
    return np.asarray((matrices + matrices.transpose(0, 2, 1)) / 2)
