"""Simulated sightings of points on ground whose heights are known, for tests of the adjustment over points."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from matched_frames import problem_of

from gcs_mosaic.stitch.arrays import Array
from gcs_mosaic.stitch.bundle.levenberg_marquardt import AdjustmentSettings, any_lens
from gcs_mosaic.stitch.bundle.problem import Problem
from gcs_mosaic.stitch.bundle.sighted_points import SightedPoints
from gcs_mosaic.stitch.camera import projection
from gcs_mosaic.stitch.camera.geometry import Camera

CAMERA = Camera(4000, 3000, 1.2)
HEIGHT = CAMERA.focal_px  # canvas units
LENS = np.array(projection.lens_row(CAMERA))


def survey(seed: int, lines: int = 4, per_line: int = 7) -> Array:
    """True poses (n, 6): lines a third of the flying height apart, a frame each fifth of it."""
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(np.arange(per_line) * 0.2 * HEIGHT, np.arange(lines) * 0.35 * HEIGHT)
    around = rng.normal(0, 1, (x.size, 4)) * [0.03, 0.1, 0.04, 0.04]
    return np.column_stack([x.ravel(), y.ravel(), around])


def hill(places: Array) -> Array:
    """Heights (m,) of a hill of a quarter of the flying height in the middle of such a survey."""
    off = (places - np.array([0.6, 0.5]) * HEIGHT) / (0.5 * HEIGHT)
    return np.asarray(0.25 * HEIGHT * np.exp(-(off**2).sum(axis=1) / 2))


def flat(places: Array) -> Array:
    return np.zeros(len(places))


def sighted(
    poses: Array,
    heights: Callable[[Array], Array],
    seed: int,
    points: int = 900,
    noise_px: float = 0.3,
    around: float = 0.5,
) -> tuple[Problem, SightedPoints, Array]:
    """The problem at these poses with an ordinary lens, sightings with noise, and the points' true places and heights (t, 3).
    There are points up to `around` flying heights away."""
    rng = np.random.default_rng([seed, 1])
    low, high = poses[:, :2].min(axis=0) - around * HEIGHT, poses[:, :2].max(axis=0) + around * HEIGHT
    places = rng.uniform(low, high, (points, 2))
    truth = np.column_stack([places, heights(places)])
    row, point = (some.ravel() for some in np.indices((len(poses), points)))
    count = len(row)
    up = projection.pixels_from_canvas(
        poses[row], np.tile(LENS, (count, 1)), np.full(count, CAMERA.half_diagonal), truth[point, :2], truth[point, 2]
    )
    half = np.array([CAMERA.width, CAMERA.height]) / 2 / CAMERA.half_diagonal
    inside = up.valid & (abs(up.points) < half).all(axis=1)
    inside &= np.bincount(point[inside], minlength=points)[point] >= 2
    kept = np.flatnonzero(inside)[np.argsort(point[inside], kind="stable")]
    _, number = np.unique(point[kept], return_inverse=True)
    problem = problem_of(
        CAMERA, poses, [np.log(1.5), 0.0, 0.0, 0.0, 0.0], [(0, 1)], [np.zeros((1, 2))], [np.zeros((1, 2))]
    )
    noise = rng.normal(0, noise_px, (len(kept), 2)) / problem.unit_px[0]
    prior = np.stack(any_lens(AdjustmentSettings()))[:, None]
    seen = SightedPoints(row[kept], up.points[kept] + noise, number)
    return replace(problem, lens_prior=prior), seen, truth[np.unique(point[kept])]
