"""From links to poses: resection of one frame against its neighbours, or adjustment of a whole island."""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from gcs_mosaic.stitch.arrays import Array, LensesNx5, Mask, Matrices, Matrix, PairValues, PointsNx2, PosesNx6, Vector
from gcs_mosaic.stitch.bundle.certainty import note_adjusted
from gcs_mosaic.stitch.bundle.lens import expected
from gcs_mosaic.stitch.bundle.lens_kind import through_likelier_lenses
from gcs_mosaic.stitch.bundle.levenberg_marquardt import AdjustmentSettings, Solution, adjust, any_lens, cost_of
from gcs_mosaic.stitch.bundle.matched_points import MatchedPoints, Sightings, matched, sightings
from gcs_mosaic.stitch.bundle.normal_equations import Run
from gcs_mosaic.stitch.bundle.other_plane import other_poses
from gcs_mosaic.stitch.bundle.point_adjustment import Grounded, grounded
from gcs_mosaic.stitch.bundle.problem import POSE, Problem
from gcs_mosaic.stitch.bundle.relief import displacements, note_relief
from gcs_mosaic.stitch.bundle.sighted_points import well_spread
from gcs_mosaic.stitch.bundle.uncertainty import island_certainty, resected_deviation, variance_factor
from gcs_mosaic.stitch.camera import projection
from gcs_mosaic.stitch.camera.geometry import (
    Camera,
    Pose,
    View,
    canvas_from_pixels,
    moved_by_similarity,
    similarity_between,
)
from gcs_mosaic.stitch.camera.projection import lens_row, lens_terms, pose_row, with_lens
from gcs_mosaic.stitch.camera.relief import ReliefDisplacement
from gcs_mosaic.stitch.graph.view_graph import CameraNumber, Lens, ViewGraph

logger = logging.getLogger(__name__)

Key = tuple[int, int]


def level_pose_over(camera: Camera, pixels: PointsNx2, places: PointsNx2) -> Pose:
    """The level pose that best fits pixels (m, 2) to these canvas places (m, 2)."""
    level = Pose(*camera.centre)
    return moved_by_similarity(level, *similarity_between(canvas_from_pixels(level, camera, pixels), places))


@dataclass(frozen=True, slots=True)
class Resected:
    """A frame's best pose, its fit to the matches, and how well they determine it."""

    pose: Pose
    residual_px: float  # median, pixels of the feature picture
    corner_deviation_px: float  # of its least certain corner relative to the fixed others; infinite above the horizon
    cautious_deviation_px: float  # as above, assuming matches no better than the adjustment's prior


def resect(graph: ViewGraph, frame: int, rough: Pose, island: int, settings: AdjustmentSettings) -> Resected:
    """Best pose of one frame against the linked frames of an island, which stay fixed."""
    linked = [other for other in graph.frames[frame].inliers if graph.islands[other] == island]
    keys = [(frame, other) if (frame, other) in graph.links else (other, frame) for other in linked]
    poses = [rough, *(graph.pose_of(other) for other in linked)]
    free = np.arange(len(poses)) == 0
    settings = _as_uneven(settings, graph.unevenness.get(island, 0.0))
    problem, cameras = _problem(graph, island, [frame, *linked], poses, keys, free, settings)
    problem = replace(problem, lens_free=False)
    solution = adjust(problem, settings)
    residual = float(np.nanmedian(np.minimum(solution.residuals_px, 1e3)))
    factors = variance_factor(solution.residuals_px, settings.loss_px, POSE), max(1.0, residual) ** 2
    deviations = (resected_deviation(problem, solution, cameras, factor) for factor in factors)
    return Resected(Pose(*solution.poses[0]), residual, *deviations)


def _as_uneven(settings: AdjustmentSettings, unevenness: float) -> AdjustmentSettings:
    """The settings for ground of at least this unevenness: over mountains what heights shift is no error of a true frame."""
    return replace(settings, relief=replace(settings.relief, sigma=max(settings.relief.sigma, unevenness)))


@dataclass(frozen=True, slots=True)
class IslandTask:
    """A snapshot of a whole island, ready to be adjusted; independent of later changes to the graph. Picklable."""

    island: int
    members: tuple[int, ...]  # frames, in the order of the problem
    root: int  # row of the island's founding frame
    problem: Problem
    matches: MatchedPoints | None  # rows as in the problem; None if no relief is wanted
    numbers: tuple[CameraNumber, ...]  # of the problem's cameras
    cameras: tuple[Camera, ...]
    settings: AdjustmentSettings


@dataclass(frozen=True, slots=True)
class AdjustedIsland:
    """Result of adjusting n frames; residuals in pixels of the feature picture, NaN without matches."""

    poses: PosesNx6  # (n, 6)
    lenses: LensesNx5  # (c, 5)
    lens_information: Matrices | None  # (c, 5, 5), None if the matches leave a degree of freedom open
    fisheye: Mask  # (c,) which of the lenses are
    lens_refused: Mask  # (c,) as in `Solution.refused`
    residuals: Vector  # (n,) median over a frame's matches
    deviations_px: Vector  # (n,) of the least certain corner, full-resolution pixels
    reliefs: list[ReliefDisplacement | None]
    unevenness: float | None  # as in `Grounded`


def island_task(graph: ViewGraph, island: int, settings: AdjustmentSettings) -> IslandTask | None:
    """The adjustment of all frames of an island at their present poses; None without links."""
    members = graph.members(island).tolist()
    inside = set(members)
    keys = [(a, b) for a, b in graph.links if a in inside and b in inside]
    if not keys:
        return None
    poses, free = [graph.pose_of(f) for f in members], np.ones(len(members), bool)
    problem, cameras = _problem(graph, island, members, poses, keys, free, settings)
    root = members.index(graph.roots[island])
    matches = matched(graph, members) if settings.relief.cells else None
    numbers = _camera_numbers(graph, members)
    return IslandTask(island, tuple(members), root, problem, matches, tuple(numbers), tuple(cameras), settings)


def adjusted(task: IslandTask, run: Run = map) -> AdjustedIsland:
    """Run the adjustment, over a plane and then over points: a pure function, for any process. `run` as in
    `normal_equations.solve`."""
    solution = _over_likelier_plane(task, adjust(task.problem, task.settings, run), run)
    solution, fisheye = through_likelier_lenses(task.problem, solution, task.settings, run)
    task = _with_kinds(task, fisheye)
    certainty = island_certainty(task.problem, solution, task.cameras, task.root, task.settings.loss_px, run)
    seen = None if task.matches is None else sightings(task.matches)
    found = _over_points(task, solution, seen, run)
    return AdjustedIsland(
        poses=found.drawn,
        lenses=found.lenses,
        lens_information=certainty.lens_information,
        fisheye=fisheye,
        lens_refused=solution.refused & (found.lenses == solution.lenses).all(axis=1),
        residuals=_residuals_by_frame(task.problem, solution.residuals_px),
        deviations_px=certainty.deviations_px,
        reliefs=_reliefs(task, found, seen),
        unevenness=found.unevenness,
    )


def _with_kinds(task: IslandTask, fisheye: Mask) -> IslandTask:
    """The task with these of its lenses (c,) as fisheyes."""
    cameras = tuple(replace(camera, fisheye=kind) for camera, kind in zip(task.cameras, fisheye.tolist(), strict=True))
    return replace(task, cameras=cameras, problem=replace(task.problem, fisheye=fisheye))


def _over_points(task: IslandTask, solution: Solution, seen: Sightings | None, run: Run) -> Grounded:
    """The island adjusted over points with heights, or as it lies over the plane if its matches do not suffice."""
    over_plane = Grounded(solution.poses, solution.lenses, solution.poses, None)
    if seen is None:
        return over_plane
    problem = replace(task.problem, poses=solution.poses, lenses=solution.lenses)
    centres = np.array([camera.centre for camera in task.cameras])
    camera = problem.camera[seen.row]
    pixels = (seen.pixels - centres[camera]) / problem.half_diagonal[camera, None]
    return grounded(problem, well_spread(seen.row, pixels, seen.point), task.settings, run) or over_plane


# Frames of an island that is tried over its other plane: three often fit either, and a larger one was tried while it grew. With
# four to nine frames that look ahead by 60 degrees the true plane costs 0.2 to 0.6 of the other; what comes back to the present
# one costs 0.97 to 1.01 of it.
OTHERWISE = range(4, 24)
LIKELIER = 0.8


def _over_likelier_plane(task: IslandTask, found: Solution, run: Run) -> Solution:
    """What was found, or the same frames over the plane that explains them otherwise, if that fits clearly better."""
    if len(task.members) not in OTHERWISE:
        return found
    cameras = [with_lens(task.cameras[camera], found.lenses[camera]) for camera in task.problem.camera]
    poses = other_poses(found.poses, cameras)
    if poses is None:
        return found
    other = adjust(replace(task.problem, poses=poses), task.settings, run)
    costs = [cost_of(task.problem, one, task.settings) for one in (found, other)]
    return other if costs[1] < LIKELIER * costs[0] else found


def _reliefs(task: IslandTask, found: Grounded, seen: Sightings | None) -> list[ReliefDisplacement | None]:
    if seen is None:
        return [None] * len(task.members)
    cameras = [with_lens(camera, lens) for camera, lens in zip(task.cameras, found.lenses, strict=True)]
    of_frames = [cameras[camera] for camera in task.problem.camera]
    views, drawn = (
        [(Pose(*pose), camera) for pose, camera in zip(poses.tolist(), of_frames, strict=True)]
        for poses in (found.poses, found.drawn)
    )
    return displacements(seen, views, task.settings.relief, drawn=drawn)


def take_in(graph: ViewGraph, task: IslandTask, found: AdjustedIsland) -> bool:
    """Align the result to the drawn poses as well as possible, and carry along frames placed since.

    Returns False, without changes, if frames of the task have left the island.
    """
    members = list(task.members)
    if (graph.islands[members] != task.island).any():
        return False
    before = {f: (graph.pose_of(f), graph.camera_of(f)) for f in members}
    lenses = adjusted_lenses(task, found)
    poses = [Pose(*pose) for pose in found.poses.tolist()]
    cameras = [lenses[graph.frames[f].camera].camera for f in members]
    _tell_refused(graph, task.island, lenses)
    aligned = _aligned_to_drawn(graph, members, poses, cameras)
    graph.put_all(members, aligned, task.island, lenses)
    if found.unevenness is not None:
        graph.unevenness[task.island] = found.unevenness
    _carry_along(graph, before, task)
    for frame, residual, relief in zip(members, found.residuals.tolist(), found.reliefs, strict=True):
        graph.note(frame, residual_px=residual * graph.frames[frame].features.scale, relief=relief)
    note_adjusted(graph, task.island, members, found.deviations_px)
    return True


def adjust_island(graph: ViewGraph, island: int, settings: AdjustmentSettings) -> None:
    """Adjust all frames of an island and their lenses at once."""
    task = island_task(graph, island, settings)
    if task is not None:
        take_in(graph, task, adjusted(task))


def _carry_along(graph: ViewGraph, before: dict[int, View], task: IslandTask) -> None:
    """Frames that joined the island during its adjustment move with the frames they are linked with.

    Frames newer than the task's were placed by resection and are resected again, as their neighbours' poses have improved.
    """
    views, newest = dict(before), max(task.members)
    waiting = [f for f in graph.members(task.island).tolist() if f not in before]
    while waiting:
        linked = {f: [other for other in graph.frames[f].inliers if other in views] for f in waiting}
        reached = [f for f in waiting if linked[f]]
        if not reached:
            return
        for frame in reached:
            view = graph.pose_of(frame), graph.camera_of(frame)
            old = _inner_corners([views[other] for other in linked[frame]])
            new = _inner_corners([(graph.pose_of(other), graph.camera_of(other)) for other in linked[frame]])
            seen = np.isfinite(old).all(axis=1) & np.isfinite(new).all(axis=1)
            if seen.sum() >= 4:
                moved = moved_by_similarity(view[0], *similarity_between(old[seen], new[seen]))
                graph.put(frame, moved, task.island)
            views[frame] = view
        waiting = [f for f in waiting if f not in views]
    for frame in sorted(f for f in views if f > newest):
        rough = graph.pose_of(frame)
        graph.put(frame, resect(graph, frame, rough, task.island, task.settings).pose, task.island)
        note_relief(graph, frame, task.settings.relief)


def _residuals_by_frame(problem: Problem, residuals: PairValues) -> Vector:
    """Median (n,) over each frame's matches, of residuals (p, k); NaN without matches."""
    order = np.argsort(problem.pairs.ravel(), kind="stable")
    ends = np.searchsorted(problem.pairs.ravel()[order], np.arange(len(problem.poses) + 1))
    of_pair = residuals[order // 2]
    return np.array(
        [np.nanmedian(of_pair[a:b]) if b > a else math.nan for a, b in pairwise(ends.tolist())], dtype=np.float64
    )


def _camera_numbers(graph: ViewGraph, frames: Sequence[int]) -> list[CameraNumber]:
    """Camera numbers of these frames, ascending: the cameras of their adjustment."""
    return sorted({graph.frames[frame].camera for frame in frames})


def _problem(
    graph: ViewGraph,
    island: int,
    frames: Sequence[int],
    poses: list[Pose],
    keys: list[Key],
    free: Mask,
    settings: AdjustmentSettings,
) -> tuple[Problem, list[Camera]]:
    """The adjustment of these frames on an island by these links, and its cameras; `free` (n,): frames that may move."""
    row = {frame: i for i, frame in enumerate(frames)}
    numbers = _camera_numbers(graph, frames)
    cameras = [graph.camera_on(island, number) for number in numbers]
    camera = {frame: numbers.index(graph.frames[frame].camera) for frame in frames}
    pixels, present = _matches(graph, keys, camera, cameras, settings.matches_per_pair)
    heights = [cameras[camera[f]].focal_px * math.exp(pose.log_gsd) for f, pose in zip(frames, poses, strict=True)]
    scale = {camera[frame]: graph.frames[frame].features.scale for frame in frames}
    problem = Problem(
        poses=np.array([pose_row(pose) for pose in poses]),
        lenses=np.array([lens_terms(camera) for camera in cameras]),
        fisheye=np.array([camera.fisheye for camera in cameras]),
        camera=np.array([camera[frame] for frame in frames]),
        half_diagonal=np.array([c.half_diagonal for c in cameras]),
        unit_px=np.array([c.half_diagonal / scale[i] for i, c in enumerate(cameras)]),
        pairs=np.array([[row[a], row[b]] for a, b in keys], dtype=np.intp).reshape(-1, 2),
        pixels_a=pixels[0],
        pixels_b=pixels[1],
        present=present,
        free=free,
        relief=settings.relief.sigma * float(np.median(heights)),
        lens_prior=np.stack([_lens_prior(graph, island, number, settings) for number in numbers], axis=1),
    )
    return problem, cameras


def _lens_prior(graph: ViewGraph, island: int, number: CameraNumber, settings: AdjustmentSettings) -> Matrix:
    """Prior mean and standard deviation of a camera's lens on an island, (2, 5).

    Islands with fewer of its frames learn from the one with most, never the other way round, so that no information returns to
    its source.
    """
    mean, sigma = any_lens(settings)
    teacher = graph.best_known_lens(number)
    shown = graph.count_with_camera(island, number)
    if teacher is None or teacher == island or graph.count_with_camera(teacher, number) <= shown:
        return np.stack([mean, sigma])
    lens = graph.lenses[teacher, number]
    if lens.camera.fisheye != graph.camera_on(island, number).fisheye:
        return np.stack([mean, sigma])
    assert lens.information is not None, "the best known lens was estimated"
    return np.stack(expected(mean, sigma, np.array(lens_terms(lens.camera)), lens.information))


def _matches(
    graph: ViewGraph, keys: list[Key], camera: dict[int, int], cameras: list[Camera], most: int
) -> tuple[Array, Mask]:
    """Matches of all links in the adjustment's units, (2, p, k, 2), and which are present, (p, k)."""
    links = [graph.links[key] for key in keys]
    present = np.arange(most) < np.array([len(link.pixels_a) for link in links])[:, None]
    centres = np.array([camera.centre for camera in cameras])
    half_diagonals = np.array([camera.half_diagonal for camera in cameras])
    pixels = np.zeros((2, len(keys), most, 2))
    for side, points in enumerate(([link.pixels_a for link in links], [link.pixels_b for link in links])):
        rows = np.array([camera[key[side]] for key in keys])[np.nonzero(present)[0]]
        pixels[side][present] = (np.concatenate(points) - centres[rows]) / half_diagonals[rows, None]
    return pixels, present


def found_cameras(task: IslandTask, found: AdjustedIsland) -> list[Camera]:
    """The cameras of a task by its result."""
    kinds = _with_kinds(task, found.fisheye).cameras
    return [with_lens(camera, lens) for camera, lens in zip(kinds, found.lenses, strict=True)]


def adjusted_lenses(task: IslandTask, found: AdjustedIsland) -> dict[CameraNumber, Lens]:
    """The lenses of a task's cameras, in their order, by its result."""
    information = [None] * len(task.numbers) if found.lens_information is None else list(found.lens_information)
    cameras = found_cameras(task, found)
    known = zip(cameras, information, found.lens_refused.tolist(), strict=True)
    return dict(zip(task.numbers, (Lens(*one) for one in known), strict=True))


def _tell_refused(graph: ViewGraph, island: int, lenses: dict[CameraNumber, Lens]) -> None:
    """Log lenses that are refused and were not before."""
    for number, lens in lenses.items():
        if lens.refused and not ((island, number) in graph.lenses and graph.lenses[island, number].refused):
            logger.warning(
                "island %d: the matches do not determine the lens of its frames of %d x %d px and pull it to where it is not "
                "believed; it is refused, and an ordinary one is used, with a focal length of %.2f half-diagonals",
                *(island, lens.camera.width, lens.camera.height, lens.camera.focal),
            )


def _aligned_to_drawn(graph: ViewGraph, members: list[int], poses: list[Pose], cameras: list[Camera]) -> list[Pose]:
    """Move the whole island by the one similarity that least disturbs what is already drawn."""
    views = [(pose, camera, graph.frames[f].drawn) for f, pose, camera in zip(members, poses, cameras, strict=True)]
    new = _inner_corners([(pose, camera) for pose, camera, drawn in views if drawn])
    old = _inner_corners([drawn for _, _, drawn in views if drawn])
    seen = np.isfinite(new).all(axis=1) & np.isfinite(old).all(axis=1)
    if seen.sum() < 4:
        return poses
    similarity = similarity_between(new[seen], old[seen])
    return [moved_by_similarity(pose, *similarity) for pose in poses]


def _inner_corners(views: list[View]) -> PointsNx2:
    """Canvas places of four points of each frame, half-way from the centre to the corners, (4 * n, 2)."""
    if not views:
        return np.empty((0, 2))
    cameras = [camera for _, camera in views]
    unit = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
    half_diagonals = np.array([c.half_diagonal for c in cameras]).repeat(4)
    half_sizes = np.array([[c.width, c.height] for c in cameras]).repeat(4, axis=0) / 2
    down = projection.canvas_from_pixels(
        np.array([pose_row(pose) for pose, _ in views]).repeat(4, axis=0),
        np.array([lens_row(camera) for camera in cameras]).repeat(4, axis=0),
        half_diagonals,
        np.tile(unit, (len(views), 1)) * half_sizes / half_diagonals[:, None],
    )
    return np.where(down.valid[:, None], down.points, np.nan)
