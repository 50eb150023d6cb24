"""Prior knowledge of a lens: limits of all cameras, and what other islands have found of this one.

Lenses are rows of their terms: log focal, k1, k2, shift_x, shift_y.
"""

from __future__ import annotations

import numpy as np

from gcs_mosaic.stitch.arrays import LensesNx5, Mask, SquareMatrix, Vector
from gcs_mosaic.stitch.camera.geometry import lens_reach

# Half-diagonals. A lens of 127 degrees across its diagonal has 0.5, a survey camera with 135 mm on 35 mm film 6.24.
SHORTEST_FOCAL, LONGEST_FOCAL = 0.5, 6.5
# Displacement of a corner by the two radial terms, relative to its radius. Wide action cameras shrink it by a third and more;
# no lens is made that pushes it outward by more than a twentieth.
MOST_BARREL, MOST_PINCUSHION = 0.45, 0.05
# The same of a fisheye, relative to one whose radii grow as the angles: a stereographic one of 160 degrees across its diagonal
# has 0.2, and what leads to that goes beyond it.
MOST_OF_FISHEYES = 0.45
REACH = 1.1  # corner radii up to which a lens must not fold the image back
# Inflation of another island's standard deviations: matches of one flight share errors.
DOUBT = 3.0
LEAST_SIGMA = np.array([0.03, 0.01, 0.01, 0.005, 0.005])  # the camera may have zoomed or refocused in between


def believable(lenses: LensesNx5, fisheye: Mask | None = None) -> LensesNx5:
    """The nearest lenses (c, 5) that a camera can have; unchanged where already possible. `fisheye`: which are, (c,)."""
    found = lenses.copy()
    found[:, 0] = np.clip(found[:, 0], np.log(SHORTEST_FOCAL), np.log(LONGEST_FOCAL))
    corner, shift = np.exp(-found[:, 0]), corner_shifts(found)
    outward = MOST_PINCUSHION if fisheye is None else np.where(fisheye, MOST_OF_FISHEYES, MOST_PINCUSHION)
    most = np.where(shift > 0, outward, MOST_BARREL)
    found[:, 1:3] *= np.minimum(1.0, most / np.maximum(abs(shift), 1e-12))[:, None]
    for _ in range(FOLDING_STEPS):
        folds = lens_reach(found[:, 1], found[:, 2]) < REACH * corner
        found[folds, 1:3] *= 0.8
    return found


def corner_shifts(lenses: LensesNx5) -> Vector:
    """Displacement (c,) of a frame's corner by the two radial terms, relative to its radius; negative towards the middle."""
    corner = np.exp(-lenses[:, 0])
    return np.asarray(lenses[:, 1] * corner**2 + lenses[:, 2] * corner**4)


FOLDING_STEPS = 20  # each removes a fifth of the distortion: what remains folds nothing


def expected(
    general_mean: Vector, general_sigma: Vector, found: Vector, information: SquareMatrix
) -> tuple[Vector, Vector]:
    """Mean and standard deviation (5,) of a lens, given another island's estimate.

    general_mean, general_sigma: (5,) of any lens; found (5,) and information (5, 5), the inverse of its covariance.
    """
    formal = np.sqrt(np.maximum(np.diag(np.linalg.pinv(information, hermitian=True)), 0.0))
    sigma = np.maximum(DOUBT * formal, LEAST_SIGMA)
    weight, general = 1 / sigma**2, 1 / general_sigma**2
    return (weight * found + general * general_mean) / (weight + general), np.sqrt(1 / (weight + general))


def focal_spread(sigma: Vector, general_sigma: float) -> Vector:
    """Standard deviation (c,) of log focal about its prior mean, of any lens or as far as another island's estimate goes.

    The prior's own, `general_sigma`, is that of common cameras. What is stated must hold for all: any focal length within the
    limits, uniform in its log. `sigma` (c,): of the priors, as `expected` combines them with an estimate.
    """
    of_estimate = np.maximum(1 / sigma**2 - 1 / general_sigma**2, 0.0)
    of_any = np.log(LONGEST_FOCAL / SHORTEST_FOCAL) / np.sqrt(12)
    return np.asarray(1 / np.sqrt(of_estimate + 1 / of_any**2))
