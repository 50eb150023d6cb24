"""Whether a lens is a fisheye: both kinds are tried where the matches say that it is no ordinary one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gcs_mosaic.stitch.arrays import Array, Mask, Vector
from gcs_mosaic.stitch.bundle.lens import corner_shifts
from gcs_mosaic.stitch.bundle.levenberg_marquardt import AdjustmentSettings, Solution, adjust, any_lens, cost_of
from gcs_mosaic.stitch.bundle.normal_equations import Run
from gcs_mosaic.stitch.bundle.problem import Problem
from gcs_mosaic.stitch.camera.geometry import Camera, distort, undistort
from gcs_mosaic.stitch.camera.projection import lens_terms, with_lens

# Displacement of a corner, relative to its radius, from which on both kinds are tried: those of fisheyes of 100 degrees across
# their diagonal and more are pulled in by a fifth and more, ordinary lenses by a twentieth.
WIDE = 0.1
LEAST_FRAMES = 5  # with fewer either kind explains all
# Of the other kind's cost: fisheyes of 110 degrees cost 0.6 of what they cost as the other kind, of 140 and more 0.3 and less.
LIKELIER = 0.9
# The same where the lens is refused and a prior stands in for it, to which much is likelier: fisheyes of 150 degrees cost 0.2.
FAR_LIKELIER = 0.5
SAMPLES = 48  # radii from the middle of a frame to its corner


def through_likelier_lenses(
    problem: Problem, solution: Solution, settings: AdjustmentSettings, run: Run = map
) -> tuple[Solution, Mask]:
    """The solution, or that of the same frames through lenses of the other kind where that fits clearly better, and which of its
    lenses are fisheyes, (c,). One lens after the other: those of several cameras may be of both kinds."""
    fisheye = np.zeros(len(problem.lenses), bool) if problem.fisheye is None else problem.fisheye
    if not problem.lens_free:
        return solution, fisheye
    problem = replace(problem, fisheye=fisheye, lens_prior=_prior(problem, settings))
    doubtful = fisheye | solution.refused | (corner_shifts(solution.lenses) < -WIDE)
    doubtful &= np.bincount(problem.camera, minlength=len(fisheye)) >= LEAST_FRAMES
    for number in np.flatnonzero(doubtful).tolist():
        other = _otherwise(problem, solution, number, settings)
        found = adjust(other, settings, run)
        costs = cost_of(problem, solution, settings), cost_of(other, found, settings)
        enough = FAR_LIKELIER if solution.refused[number] else LIKELIER
        if costs[1] < enough * costs[0] and not found.refused[number]:
            problem, solution, fisheye = other, found, fisheye ^ (np.arange(len(fisheye)) == number)
    return solution, fisheye


def _otherwise(problem: Problem, solution: Solution, number: int, settings: AdjustmentSettings) -> Problem:
    """The problem as solved, with this lens as one of the other kind, of which other islands say nothing."""
    assert problem.fisheye is not None, "filled in"
    assert problem.lens_prior is not None, "filled in"
    fisheye, lenses, prior = problem.fisheye.copy(), solution.lenses.copy(), problem.lens_prior.copy()
    lenses[number] = as_other_kind(with_lens(Camera(1, 1, fisheye=bool(fisheye[number])), lenses[number]))
    fisheye[number] ^= True
    prior[:, number] = any_lens(settings)
    return replace(problem, poses=solution.poses, lenses=lenses, fisheye=fisheye, lens_prior=prior, lens_weights=None)


def _prior(problem: Problem, settings: AdjustmentSettings) -> Array:
    general = np.stack(any_lens(settings))[:, None].repeat(len(problem.lenses), axis=1)
    return general if problem.lens_prior is None else problem.lens_prior


def as_other_kind(camera: Camera) -> Vector:
    """Terms (5,) of the lens of the other kind that shows each place nearest to where this one does, with its focal length: by
    least squares over the radii of a frame that both have."""
    other = replace(camera, fisheye=not camera.fisheye, k1=0.0, k2=0.0)
    distorted = np.linspace(0, 1, SAMPLES + 1)[1:] / camera.focal
    straight = undistort(camera, np.stack([distorted, np.zeros(SAMPLES)]))
    radii = distort(other, straight)[0]
    radii, distorted = radii[np.isfinite(radii)], distorted[np.isfinite(radii)]
    # radius * (1 + k1 * radius**2 + k2 * radius**4) = distorted
    by_terms = np.stack([radii**3, radii**5], axis=1)
    terms = lens_terms(camera)
    found = np.linalg.lstsq(by_terms, distorted - radii, rcond=None)[0] if len(radii) > 2 else np.zeros(2)
    return np.array([terms[0], *found, *terms[3:]])
