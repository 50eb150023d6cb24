"""Bundle adjustment over points with heights: what holds the map where the ground is no plane.

The adjustment over a plane takes each match's height for a noise of its own. A hill is none: its heights agree from frame to
frame, and they bend the map, tilts and the focal length until they are explained. Here all sightings of a point share one place
and one height, as in structure-from-motion, and the plane only says how high points are expected to be. It is begun from the
adjustment over the plane, which finds the way from rough poses; without enough points in common an island stays as that has it.

Levenberg-Marquardt on the reduced equations (`point_equations`). After each step the points settle once more, else steps along
what is hardly determined (heights and focal length, all at once) would have to be short (Jeong et al., "Pushing the Envelope of
Modern Methods for Bundle Adjustment", IEEE PAMI 34(8), 2012: embedded point iterations).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from gcs_mosaic.stitch.arrays import LensesNx5, Matrix, PointsNx2, PosesNx6, RowsNx3
from gcs_mosaic.stitch.bundle.drawn_poses import drawn_poses
from gcs_mosaic.stitch.bundle.elimination import BLOCK
from gcs_mosaic.stitch.bundle.levenberg_marquardt import AdjustmentSettings, lenses_after, stepped, without_leaps
from gcs_mosaic.stitch.bundle.normal_equations import Run, solve
from gcs_mosaic.stitch.bundle.point_equations import (
    HeightPrior,
    PointEquations,
    PointLayout,
    PointState,
    flying_height,
    point_layout,
)
from gcs_mosaic.stitch.bundle.problem import Problem
from gcs_mosaic.stitch.bundle.relief_points import ground_points
from gcs_mosaic.stitch.bundle.sighted_points import SightedPoints, patch_shares
from gcs_mosaic.stitch.camera import projection
from gcs_mosaic.stitch.camera.projection import LENS_TERMS

PATCH = 0.25  # flying heights: side of a piece of ground that has one height, as far as the prior counts them
FEWEST_FRAMES = 6  # of fewer, most points are seen by two alone, whose heights any tilt explains
FEWEST = 10  # sightings of each frame
MOST_OFF = 10.0  # loss scales: a sighting farther off is of something else, or of nothing
SETTLING = 2  # steps of the points alone after each step
# Heights are expected to be as even as the settings say, and twice as uneven as long as that lowers the cost by more than a
# fifth: at first by 40 to 55 % over hills and cliffs of a quarter of the flying height, by 0.2 to 12 % over recorded flights.
LIKELIER = 0.8
MOST_UNEVEN = 0.3  # flying heights


@dataclass(frozen=True, slots=True)
class Grounded:
    """n frames adjusted over points."""

    poses: PosesNx6  # (n, 6) where the cameras were
    lenses: LensesNx5  # (c, 5)
    drawn: PosesNx6  # (n, 6) poses over the plane that show the ground where it is, seen from above
    unevenness: float | None  # deviation of heights at which they are likeliest, in flying heights; None: not known


def grounded(problem: Problem, seen: SightedPoints, settings: AdjustmentSettings, run: Run = map) -> Grounded | None:
    """A problem, as solved over the plane, adjusted over these points; `run` as in `normal_equations.solve`.

    None if they do not hold all frames together, or pull a lens to where none is believed or a frame away from what it sees.
    """
    points = _first_points(problem, seen, settings)
    known = np.asarray(np.isfinite(points).all(axis=1))  # where no ray goes above the horizon
    seen, points = seen.kept(known[seen.point]), points[known]
    if not _hold_together(seen, len(problem.poses)):
        return None
    problem, sigma = _with_priors(problem, settings), settings.relief.sigma
    equations = PointEquations(point_layout(problem, seen), seen, settings, run)
    shares = patch_shares(points[:, :2], PATCH * flying_height(problem))
    found = _converged(equations, equations.at(problem, points, HeightPrior(sigma, shares)))
    while sigma < MOST_UNEVEN:
        sigma *= 2
        uneven = _converged(equations, equations.at(found.problem, found.points, HeightPrior(sigma, shares)))
        if uneven.cost > LIKELIER * found.cost:
            break
        found = uneven
    drawn = drawn_poses(found.problem, seen, found.points)
    if found.stopped or not np.isfinite(drawn).all() or _lost(equations, found):
        return None
    return Grounded(found.problem.poses, found.problem.lenses, drawn, found.prior.sigma)


def _hold_together(seen: SightedPoints, frames: int) -> bool:
    if frames < FEWEST_FRAMES or not len(seen.row) or (np.bincount(seen.row, minlength=frames) < FEWEST).any():
        return False
    one, other = seen.pairs().T
    links = sparse.coo_matrix((np.ones(len(one), np.int8), (one, other)), shape=(frames, frames))
    return int(connected_components(links, directed=False, return_labels=False)) == 1


def _lost(equations: PointEquations, found: PointState) -> bool:
    """Whether there is a frame that sees most of its points elsewhere."""
    row, off = equations.seen.row, equations.residuals_px(found) > MOST_OFF * equations.settings.loss_px
    return bool((np.bincount(row, off) > np.bincount(row) / 2).any())


def _first_points(problem: Problem, seen: SightedPoints, settings: AdjustmentSettings) -> RowsNx3:
    """Places and heights (t, 3) of the points at a problem's poses."""
    camera = problem.camera[seen.row]
    poses, half_diagonals = problem.poses[seen.row], problem.half_diagonal[camera]
    down = projection.canvas_from_pixels(poses, problem.lens_rows(camera), half_diagonals, seen.pixels)
    deviations = np.exp(poses[:, 2]) * half_diagonals / problem.unit_px[camera] * settings.loss_px
    places = np.where(down.valid[:, None], down.points, np.nan)
    sigma = settings.relief.sigma * flying_height(problem)
    found = ground_points(places, down.by_height, deviations, seen.point, sigma)
    return np.column_stack([found.places, found.heights])


def _with_priors(problem: Problem, settings: AdjustmentSettings) -> Problem:
    assert problem.lens_prior is not None, "an island's problem has one"
    weights = np.eye(LENS_TERMS) / problem.lens_prior[1][:, None] ** 2
    return replace(problem, lens_weights=weights, tilt_prior=_expected_tilts(problem, settings.tilt_prior_sigma))


def _expected_tilts(problem: Problem, sigma: float) -> PointsNx2:
    """Pitch and roll (c, 2) that the frames of each camera are expected to have: the middle ones over the plane, if they are
    large beside the deviation from level flight.

    Pulled to level flight, cameras that all look ahead would tilt the ground, whose heights are free, towards them. Small ones
    are more often those of a plane that was fitted to slopes than of a camera that hangs askew.
    """
    tilts = [np.median(problem.poses[problem.camera == camera, 4:], axis=0) for camera in range(len(problem.lenses))]
    size4 = (np.array(tilts) ** 2).sum(axis=1, keepdims=True) ** 2
    return np.asarray(tilts * size4 / (size4 + sigma**4))


def _converged(equations: PointEquations, state: PointState) -> PointState:
    """Where no step lowers the cost any more."""
    damping, most = 1e-4, equations.settings.steps
    for _ in range(most):
        before = state
        state, damping = _descended(equations, before, damping)
        if before.cost - state.cost < equations.settings.step_tolerance * before.cost:
            break
    return state


def _descended(equations: PointEquations, state: PointState, damping: float) -> tuple[PointState, float]:
    """The state after a step that lowers the cost, or as it is if none does, and the next damping."""
    stopped = False
    for _ in range(TRIES):
        step = solve(state.normal, state.gradient, damping, equations.run)
        if step is not None:
            problem, stopped = _stepped(state.problem, equations.layout, step)
            taken = _difference(state.problem, problem, equations.layout)
            points = equations.settled(problem, state.points_after(equations.layout, taken), state.prior, SETTLING)
            candidate = equations.at(problem, points, state.prior)
            if candidate.cost < state.cost:
                return replace(candidate, stopped=stopped), max(damping / 5, 1e-9)
        damping *= 8
    return replace(state, stopped=stopped), damping


TRIES = 6  # of a step, each more damped


def _stepped(problem: Problem, layout: PointLayout, step: Matrix) -> tuple[Problem, bool]:
    """The problem after a step, and whether a lens was kept within its limits."""
    after = without_leaps(stepped(problem, layout.equations, step), problem.poses)
    return after, bool((after.lenses != lenses_after(problem, layout.equations, step)).any())


def _difference(before: Problem, after: Problem, layout: PointLayout) -> Matrix:
    """The step (v, BLOCK) that was really taken."""
    taken = np.zeros((layout.equations.vertices, BLOCK))
    taken[layout.equations.frames] = after.poses - before.poses
    taken[layout.equations.lenses, :LENS_TERMS] = after.lenses - before.lenses
    return taken
