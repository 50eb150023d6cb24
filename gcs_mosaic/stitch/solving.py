"""From links to poses: one frame against its neighbours (resection), or a whole island at once."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.stitch import projection
from gcs_mosaic.stitch.adjustment import AdjustmentSettings, Problem, Solution, adjust
from gcs_mosaic.stitch.certainty import note_adjusted
from gcs_mosaic.stitch.deviation import POSE, island_deviations, resected_deviation, variance_factor
from gcs_mosaic.stitch.geometry import Camera, Pose, canvas_from_pixels, moved_by_similarity, similarity_between
from gcs_mosaic.stitch.network import Network
from gcs_mosaic.stitch.projection import lens_row, pose_row, with_lens

Array = NDArray[np.float64]
Key = tuple[int, int]


def level_pose_over(camera: Camera, pixels: Array, places: Array) -> Pose:
    """The level pose from which pixels (m, 2) look most like these canvas places (m, 2)."""
    level = Pose(*camera.centre)
    return moved_by_similarity(level, *similarity_between(canvas_from_pixels(level, camera, pixels), places))


@dataclass(frozen=True, slots=True)
class Resected:
    """A frame's best pose, how well it fits its matches, and how well they determine it."""

    pose: Pose
    residual_px: float  # median, pixels of the feature picture
    corner_deviation_px: float  # of its least certain corner against the others as they lie; infinite above the horizon
    cautious_deviation_px: float  # the same, if matches were not better than the adjustment takes for granted


def resect(network: Network, frame: int, rough: Pose, settings: AdjustmentSettings) -> Resected:
    """Best pose of one frame against its linked frames as they lie."""
    linked = [other for other in network.frames[frame].inliers if network.frames[other].pose is not None]
    keys = [(frame, other) if (frame, other) in network.links else (other, frame) for other in linked]
    poses = [rough, *(network.pose_of(other) for other in linked)]
    free = np.arange(len(poses)) == 0
    problem = replace(_problem(network, [frame, *linked], poses, keys, free, settings), lens_free=False)
    solution = adjust(problem, settings)
    residual = float(np.nanmedian(np.minimum(solution.residuals_px, 1e3)))
    factors = variance_factor(solution.residuals_px, settings.loss_px, POSE), max(1.0, residual) ** 2
    deviations = (resected_deviation(problem, solution, network.cameras, factor) for factor in factors)
    return Resected(Pose(*solution.poses[0]), residual, *deviations)


def adjust_island(network: Network, island: int, settings: AdjustmentSettings) -> None:
    """Adjust all frames of an island and their lenses, then lay the result over the held poses as well as it goes."""
    members = network.members(island).tolist()
    inside = set(members)
    keys = [(a, b) for a, b in network.links if a in inside and b in inside]
    if not keys:
        return
    poses, free = [network.pose_of(f) for f in members], np.ones(len(members), bool)
    problem = _problem(network, members, poses, keys, free, settings)
    solution = adjust(problem, settings)
    _take_lenses(network, members, solution.lenses)
    adjusted = [Pose(*pose) for pose in solution.poses]
    for frame, pose in zip(members, _aligned_to_held(network, members, adjusted), strict=True):
        network.put(frame, pose, island)
    _note_residuals(network, members, keys, solution)
    root = members.index(network.roots[island])
    note_adjusted(
        network, island, members, island_deviations(problem, solution, network.cameras, root, settings.loss_px)
    )


def _problem(
    network: Network,
    frames: Sequence[int],
    poses: list[Pose],
    keys: list[Key],
    free: NDArray[np.bool_],
    settings: AdjustmentSettings,
) -> Problem:
    """The adjustment of these frames by these links; `free` (n,) says which may move."""
    row = {frame: i for i, frame in enumerate(frames)}
    pixels, present = _matches(network, keys, settings.matches_per_pair)
    heights = [network.camera_of(f).focal_px * math.exp(pose.log_gsd) for f, pose in zip(frames, poses, strict=True)]
    scale = {network.frames[f].camera: network.frames[f].features.scale for f in frames}
    return Problem(
        poses=np.array([pose_row(pose) for pose in poses]),
        lenses=np.array([lens_row(camera) for camera in network.cameras]),
        camera=np.array([network.frames[f].camera for f in frames]),
        half_diagonal=np.array([c.half_diagonal for c in network.cameras]),
        unit_px=np.array([c.half_diagonal / scale.get(i, 1.0) for i, c in enumerate(network.cameras)]),
        pairs=np.array([[row[a], row[b]] for a, b in keys], dtype=np.intp).reshape(-1, 2),
        pixels_a=pixels[0],
        pixels_b=pixels[1],
        present=present,
        free=free,
        relief=settings.relief_sigma * float(np.median(heights)),
    )


def _matches(network: Network, keys: list[Key], most: int) -> tuple[Array, NDArray[np.bool_]]:
    """Matches of all links in the adjustment's units, (2, p, k, 2), and which are there, (p, k)."""
    pixels, present = np.zeros((2, len(keys), most, 2)), np.zeros((len(keys), most), bool)
    for i, key in enumerate(keys):
        link = network.links[key]
        present[i, : len(link.pixels_a)] = True
        for side, points in enumerate((link.pixels_a, link.pixels_b)):
            camera = network.camera_of(key[side])
            pixels[side, i, : len(points)] = (points - camera.centre) / camera.half_diagonal
    return pixels, present


def _take_lenses(network: Network, members: list[int], lenses: Array) -> None:
    for camera in {network.frames[f].camera for f in members}:
        network.cameras[camera] = with_lens(network.cameras[camera], lenses[camera])


def _note_residuals(network: Network, members: list[int], keys: list[Key], solution: Solution) -> None:
    of_frame: dict[int, list[Array]] = {frame: [] for frame in members}
    for (a, b), residuals in zip(keys, solution.residuals_px, strict=True):
        of_frame[a].append(residuals)
        of_frame[b].append(residuals)
    for frame, residuals in of_frame.items():
        if residuals:
            state = network.frames[frame]
            state.residual_px = float(np.nanmedian(np.concatenate(residuals))) * state.features.scale


def _aligned_to_held(network: Network, members: list[int], poses: list[Pose]) -> list[Pose]:
    """Move the whole island by the one similarity that disturbs least what is already drawn."""
    held = [(pose, network.camera_of(f), network.frames[f].held) for f, pose in zip(members, poses, strict=True)]
    new = _inner_corners([(pose, camera) for pose, camera, drawn in held if drawn])
    old = _inner_corners([drawn for _, _, drawn in held if drawn])
    seen = np.isfinite(new).all(axis=1) & np.isfinite(old).all(axis=1)
    if seen.sum() < 4:
        return poses
    similarity = similarity_between(new[seen], old[seen])
    return [moved_by_similarity(pose, *similarity) for pose in poses]


def _inner_corners(views: list[tuple[Pose, Camera]]) -> Array:
    """Canvas places of four points of each frame, half-way from the middle to the corners, (4 * n, 2)."""
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
