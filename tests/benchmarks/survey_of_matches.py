"""A long simulated survey whose links are given: matches of known ground points, from known poses, with noise and wrong ones.

The path is that of `flight_of_points`. Nothing is searched for, so that an adjustment of any size is made within seconds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from gcs_mosaic.stitch.arrays import Array, IndexPairsNx2, LensesNx5, Mask, PointsNx2, PosesNx6
from gcs_mosaic.stitch.bundle.levenberg_marquardt import AdjustmentSettings
from gcs_mosaic.stitch.bundle.problem import Problem
from gcs_mosaic.stitch.camera import projection
from gcs_mosaic.stitch.camera.geometry import Camera, similarity_between
from sitl.geometry import CameraState, world_from_camera
from sitl.path import fly
from tests.benchmarks.flight_of_points import HEIGHT, LENS, NOISE_PX, plan

CAMERA = Camera(LENS.width, LENS.height, LENS.focal, LENS.k1)
LINKS = 12  # of a frame, at most: with those that it has most in common with
MATCHES = 24  # of a pair, as the adjustment uses
WRONG = 0.03  # share of the matches
NEAR = 48  # frames looked at for links
PAIRS_AT_ONCE = 512
# What is not known at the start: pixels of the first frame, shares and radians for each frame by itself, and a bend of the whole.
OFF = np.array([5.0, 5.0, 0.005, 0.005, 0.005, 0.005])
BEND_PX = 50.0


@dataclass(frozen=True, slots=True)
class Survey:
    """A problem as an adjustment gets it, and the true poses (n, 6) of its frames."""

    problem: Problem
    truth: PosesNx6


def survey(frames: int, links: int = LINKS, *, level: bool = False, seed: int = 1) -> Survey:
    """A flight of so many frames; `level`: at one height, without climbs."""
    rng, route = np.random.default_rng([seed, 11]), plan(frames)
    truth = np.array(
        [canvas_pose(state) for state in fly("survey", LENS, replace(route, climbs=0) if level else route)]
    )
    pairs = linked(truth, links)
    pixels_a, pixels_b, present = matched(truth, pairs, rng)
    problem = Problem(
        poses=disturbed(truth, rng),
        lenses=np.array([[math.log(AdjustmentSettings().focal_prior), 0.0, 0.0, 0.0, 0.0]]),
        camera=np.zeros(frames, np.intp),
        half_diagonal=np.array([CAMERA.half_diagonal]),
        unit_px=np.array([CAMERA.half_diagonal]),
        pairs=pairs,
        pixels_a=pixels_a,
        pixels_b=pixels_b,
        present=present,
        free=np.ones(frames, bool),
        relief=AdjustmentSettings().relief.sigma * float(np.median(np.exp(truth[:, 2]))) * CAMERA.focal_px,
    )
    return Survey(problem, truth)


def canvas_pose(state: CameraState) -> tuple[float, ...]:
    """A camera's pose as a row; one canvas unit is a pixel from the flight's first height."""
    turn, unit = world_from_camera(state), HEIGHT / LENS.focal_px
    return (
        state.x / unit,
        state.y / unit,
        math.log(state.height / HEIGHT),
        math.atan2(turn[1, 0], turn[0, 0]),
        math.asin(-turn[2, 0]),
        math.atan2(turn[2, 1], turn[2, 2]),
    )


def disturbed(truth: PosesNx6, rng: np.random.Generator) -> PosesNx6:
    """Poses as if each were known by itself only, and the whole were bent, as a chain of frames bends."""
    poses = truth + rng.normal(size=truth.shape) * OFF
    extent = np.ptp(truth[:, :2], axis=0).max()
    poses[:, :2] += BEND_PX * np.sin(2 * np.pi * truth[:, [1, 0]] / extent)
    return np.asarray(poses)


def linked(poses: PosesNx6, links: int) -> IndexPairsNx2:
    """Pairs (p, 2) of frames, the most overlapping first served, until each has so many links."""
    sides = np.exp(poses[:, 2:3]) * [LENS.width, LENS.height]
    _, near = cKDTree(poses[:, :2]).query(poses[:, :2], k=min(NEAR, len(poses)))
    a, b = np.arange(len(poses)).repeat(near.shape[1]), near.ravel()
    a, b = a[a < b], b[a < b]
    common = np.clip((sides[a] + sides[b]) / 2 - abs(poses[a, :2] - poses[b, :2]), 0, np.minimum(sides[a], sides[b]))
    share = common.prod(axis=1) / np.maximum(sides[a], sides[b]).prod(axis=1)
    order = np.argsort(-share, kind="stable")
    left, found = [links] * len(poses), []
    for i, j in zip(*(ends[order[share[order] > 0]].tolist() for ends in (a, b)), strict=True):
        if left[i] and left[j]:
            left[i], left[j] = left[i] - 1, left[j] - 1
            found.append((i, j))
    return np.array(sorted(found), dtype=np.intp).reshape(-1, 2)


def matched(poses: PosesNx6, pairs: IndexPairsNx2, rng: np.random.Generator) -> tuple[Array, Array, Mask]:
    """Pixels (p, MATCHES, 2) in either frame as the adjustment wants them, and which of them there are."""
    pixels, present = np.zeros((2, len(pairs), MATCHES, 2)), np.zeros((len(pairs), MATCHES), bool)
    half_size = np.array([LENS.width, LENS.height]) / CAMERA.half_diagonal / 2
    for start in range(0, len(pairs), PAIRS_AT_ONCE):
        some = slice(start, start + PAIRS_AT_ONCE)
        places = common_ground(poses[pairs[some]], rng)
        seen = np.stack([seen_at(poses[pairs[some, side]], places) for side in (0, 1)])
        inside = (abs(seen) < half_size).all(axis=(0, 3))
        first = np.argsort(~inside, axis=1, kind="stable")[:, :MATCHES]
        present[some] = np.take_along_axis(inside, first, axis=1)
        pixels[:, some] = np.where(
            present[some][..., None], np.take_along_axis(seen, first[None, ..., None], axis=2), 0
        )
    pixels += rng.normal(0, NOISE_PX / CAMERA.half_diagonal, pixels.shape)
    wrong = rng.random(present.shape) < WRONG
    pixels[1, wrong] = rng.uniform(-half_size, half_size, (int(wrong.sum()), 2))
    return pixels[0], pixels[1], present


def common_ground(poses: Array, rng: np.random.Generator) -> Array:
    """Canvas places (p, 3 * MATCHES, 2) about where two level frames at poses (p, 2, 6) would both look."""
    sides = np.exp(poses[:, :, 2:3]) * [LENS.width, LENS.height]
    low, high = (poses[:, :, :2] - sides / 2).max(axis=1), (poses[:, :, :2] + sides / 2).min(axis=1)
    shares = rng.random((len(poses), 3 * MATCHES, 2))
    return np.asarray(low[:, None] + shares * (high - low)[:, None])


def seen_at(poses: PosesNx6, places: Array) -> Array:
    """Pixels (p, k, 2) of places (p, k, 2), in half-diagonals from the middle of frames at poses (p, 6); NaN for unseen ones."""
    p, k, _ = places.shape
    lens = np.tile(projection.lens_row(CAMERA), (p * k, 1))
    half = np.full(p * k, CAMERA.half_diagonal)
    up = projection.pixels_from_canvas(poses.repeat(k, axis=0), lens, half, places.reshape(-1, 2))
    return np.where(up.valid[:, None], up.points, np.nan).reshape(p, k, 2)


def rms_error_px(poses: PosesNx6, lens: LensesNx5, truth: PosesNx6) -> float:
    """RMS distance of the frames' inner corners from their true places after one similarity, pixels of the first frame."""
    found, true = inner_corners(poses, lens), inner_corners(truth, np.array(projection.lens_row(CAMERA)))
    scale, angle, shift = similarity_between(found, true)
    turn = np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])
    return float(np.sqrt((((scale * found @ turn + shift) - true) ** 2).sum(axis=1).mean()))


def inner_corners(poses: PosesNx6, lens: NDArray[np.float64]) -> PointsNx2:
    """Canvas places (4 * n, 2) half-way from the middle of each frame to its corners."""
    corners = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]]) * [0.8, 0.6]
    half, count = np.full(4 * len(poses), CAMERA.half_diagonal), 4 * len(poses)
    return projection.canvas_from_pixels(
        poses.repeat(4, axis=0), np.tile(lens, (count, 1)), half, np.tile(corners, (len(poses), 1))
    ).points
