"""The lowest thing in focus is the ground; where nothing is, or it cannot be told, nothing is claimed."""

import cv2
import numpy as np
import pytest

from gcs_mosaic.integral.focus import LEAST_RATIO, agreement, lowest_focus
from gcs_mosaic.integral.stack import GroundWindow, Look
from gcs_mosaic.stitch.camera.geometry import Camera, Pose, canvas_from_pixels, pixel_grid

CAMERA = Camera(320, 240, focal=1.45)
POSES = [Pose(float(x), float(y)) for x in (-60, 0, 60) for y in (-40, 40)]
ABOVE = CAMERA.focal_px
WINDOW = GroundWindow(0.0, 0.0, 100.0, 100)
TEXTURE = 1024  # px of a random ground, canvas units wide


def painted(pose: Pose, ground: np.ndarray, height: float) -> np.ndarray:
    """What a camera sees of a picture that lies at a height."""
    flat = canvas_from_pixels(pose, CAMERA, pixel_grid(CAMERA, CAMERA.width, CAMERA.height))
    nadir = np.array([pose.x, pose.y])
    places = nadir + (flat - nadir) * (ABOVE - height) / ABOVE + TEXTURE / 2
    at = places.reshape(CAMERA.height, CAMERA.width, 2).astype(np.float32)
    return np.asarray(cv2.remap(ground, at, np.empty(0), cv2.INTER_LINEAR))


def noise(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return cv2.GaussianBlur(rng.standard_normal((TEXTURE, TEXTURE)).astype(np.float32), (0, 0), 2.0) * 50


def looks(ground: float, crowns: float) -> list[Look]:
    """Half of the ground at one height is hidden by leaves at another."""
    floor, leaves, gaps = noise(1), noise(2), noise(3)
    found = []
    for pose in POSES:
        hidden = painted(pose, gaps, crowns) > 0
        image = np.where(hidden, painted(pose, leaves, crowns), painted(pose, floor, ground))
        found.append(Look(f"{pose}", pose, CAMERA, image[..., None].astype(np.float32)))
    return found


def test_the_ground_is_found_beneath_the_crowns() -> None:
    heights = np.linspace(-30, 60, 46)
    ratios = np.array([agreement(looks(-10.0, 30.0), WINDOW, height) for height in heights])
    found = lowest_focus(heights, ratios)
    assert found is not None
    assert found.height == pytest.approx(-10.0, abs=2.0)
    assert found.lowest < -10.0 < found.highest < 30.0


def test_looks_that_share_nothing_agree_on_no_height() -> None:
    apart = [
        Look(f"{seed}", pose, CAMERA, painted(pose, noise(seed), 0.0)[..., None]) for seed, pose in enumerate(POSES)
    ]
    ratios = np.array([agreement(apart, WINDOW, height) for height in np.linspace(-30, 60, 19)])
    assert ratios.max() < LEAST_RATIO
    assert lowest_focus(np.linspace(-30, 60, 19), ratios) is None


def test_one_camera_tells_no_height() -> None:
    pose = POSES[0]
    same = [Look(f"{k}", pose, CAMERA, painted(pose, noise(1), 0.0)[..., None]) for k in range(3)]
    heights = np.linspace(-30, 60, 19)
    ratios = np.array([agreement(same, WINDOW, height) for height in heights])
    assert lowest_focus(heights, ratios) is None


def test_a_peak_at_the_end_of_what_was_tried_is_none() -> None:
    assert lowest_focus(np.arange(5.0), np.array([3.0, 2.0, 1.2, 1.0, 1.0])) is None
    assert lowest_focus(np.arange(5.0), np.array([1.0, 1.0, 1.2, 2.0, 3.0])) is None
    found = lowest_focus(np.arange(7.0), np.array([1.0, 1.0, 2.0, 1.0, 1.5, 4.0, 1.0]))
    assert found is not None
    assert found.height == 2.0
