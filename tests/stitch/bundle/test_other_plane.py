"""A line flown with a camera that looks far ahead comes to lie on the true plane, not on the other one that two frames fit as
well, and nothing else is turned."""

import math

import numpy as np
import pytest
from matched_frames import problem_of

from gcs_mosaic.stitch.arrays import Array
from gcs_mosaic.stitch.bundle.island import IslandTask, adjusted
from gcs_mosaic.stitch.bundle.levenberg_marquardt import AdjustmentSettings, adjust
from gcs_mosaic.stitch.bundle.other_plane import other_poses
from gcs_mosaic.stitch.camera.geometry import Camera, Pose, canvas_from_pixels, pixels_from_canvas

CAMERA = Camera(4000, 3000, 1.45)
SETTINGS = AdjustmentSettings()
HEIGHT = CAMERA.focal_px  # canvas units


def line(frames: int, tilt_deg: float, seed: int) -> Array:
    """True poses (n, 6) of a straight line at one height, looking ahead by so many degrees."""
    rng, poses = np.random.default_rng(seed), np.zeros((frames, 6))
    poses[:, 1] = -np.arange(frames) * 0.25 * HEIGHT
    poses[:, 2:] = rng.normal(0, [0.01, 0.02, 0.02, 0.02], (frames, 4))
    poses[:, 5] += math.radians(tilt_deg)
    return poses


def task_of(truth: Array, start: Array, seed: int) -> IslandTask:
    """Of frames matched with the next three, with the noise of half a pixel."""
    rng, pairs, a, b = np.random.default_rng(seed), [], [], []
    for i in range(len(truth)):
        for j in range(max(0, i - 3), i):
            pixels = rng.uniform(0, 1, (2000, 2)) * [CAMERA.width, CAMERA.height]
            places = canvas_from_pixels(Pose(*truth[i]), CAMERA, pixels)
            seen = np.nan_to_num(pixels_from_canvas(Pose(*truth[j]), CAMERA, places), nan=-1.0)
            inside = np.flatnonzero(((seen > 0) & (seen < [CAMERA.width, CAMERA.height])).all(axis=1))[:24]
            pairs.append((i, j))
            a.append(pixels[inside] + rng.normal(0, 0.5, (len(inside), 2)))
            b.append(seen[inside] + rng.normal(0, 0.5, (len(inside), 2)))
    problem = problem_of(CAMERA, start, [math.log(1.5), 0.0, 0.0, 0.0, 0.0], pairs, a, b)
    return IslandTask(0, tuple(range(len(truth))), 0, problem, None, (0,), (CAMERA,), SETTINGS)


def tilts(poses: Array) -> Array:
    return np.asarray(np.degrees(np.arccos(np.cos(poses[:, 4]) * np.cos(poses[:, 5]))))


def over_the_other_plane(truth: Array) -> Array:
    found = other_poses(truth, [CAMERA] * len(truth))
    assert found is not None, "a line that looks ahead has another plane"
    return found


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("frames", [4, 6])
def test_a_line_that_looks_far_ahead_is_laid_on_the_true_plane(frames: int, seed: int) -> None:
    truth = line(frames, 60.0, seed)
    task = task_of(truth, over_the_other_plane(truth), seed)
    stays = adjust(task.problem, SETTINGS)
    assert np.abs(tilts(stays.poses) - tilts(truth)).max() > 20, "no small steps lead there"
    assert np.abs(tilts(adjusted(task).poses) - tilts(truth)).max() < 5


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("tilt_deg", [0.0, 30.0, 60.0])
def test_a_line_on_the_true_plane_stays_there(tilt_deg: float, seed: int) -> None:
    truth = line(7, tilt_deg, seed)
    task = task_of(truth, truth, seed)
    assert np.array_equal(adjusted(task).poses, adjust(task.problem, SETTINGS).poses)


def test_frames_that_look_down_have_no_other_plane() -> None:
    truth = line(7, 0.0, 1)
    assert other_poses(truth, [CAMERA] * 7) is None


def test_the_other_plane_of_two_frames_explains_the_same_matches() -> None:
    """At 60 degrees the camera seems to look down, and to turn."""
    truth = line(2, 60.0, 0)
    truth[:, 2:5] = 0.0
    other = over_the_other_plane(truth)
    assert tilts(other).max() < 45
    views = [(Pose(*pose), CAMERA) for pose in other.tolist()]
    pixels = np.array([[1000.0, 1000.0], [3000.0, 1000.0], [1000.0, 2000.0], [3000.0, 2000.0]])
    true_pixels = pixels_from_canvas(Pose(*truth[1]), CAMERA, canvas_from_pixels(Pose(*truth[0]), CAMERA, pixels))
    found = pixels_from_canvas(*views[1], canvas_from_pixels(*views[0], pixels))
    assert np.abs(found - true_pixels).max() < 0.05 * CAMERA.half_diagonal
