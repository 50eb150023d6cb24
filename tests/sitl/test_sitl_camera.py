from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from sitl.camera import Camera, Scene
from sitl.geometry import CameraState, Lens
from tests.sure import sure

NORTH = CameraState(time=0, x=-8, y=5, height=60, yaw=0.1, pitch=0.03, roll=-0.02)
SOUTH = CameraState(time=1, x=6, y=-4, height=75, yaw=3.3, pitch=-0.04, roll=0.03)
OBLIQUE = CameraState(time=2, x=0, y=40, height=40, yaw=0.2, pitch=np.radians(72))


def same_points(one: NDArray[np.uint8], other: NDArray[np.uint8]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Matched features of two pictures; without precise upscaling SIFT sees everything a quarter pixel too far right and down."""
    sift = cv2.SIFT.create(1500, enable_precise_upscale=True)
    (points, words), (others, other_words) = (sift.detectAndCompute(picture, None) for picture in (one, other))
    near = cv2.BFMatcher().knnMatch(words, other_words, 2)
    good = [first for first, second in near if first.distance < 0.7 * second.distance]
    return np.array([points[m.queryIdx].pt for m in good]), np.array([others[m.trainIdx].pt for m in good])


@pytest.mark.long
@pytest.mark.parametrize("relief", [0.0, 1.0])
def test_pictures_agree_with_the_truth(scene: Scene, relief: float) -> None:
    hilly = replace(scene, relief=relief)
    here, there = same_points(hilly.picture(NORTH, 0), hilly.picture(SOUTH, 1))
    apart = hilly.ground_from_pixels(NORTH, here) - hilly.ground_from_pixels(SOUTH, there)
    pixels = apart / (60 / scene.camera.lens.focal_px)
    right = np.hypot(*pixels.T) < 2
    assert right.sum() > 100
    assert right.mean() > 0.9
    assert np.median(np.hypot(*pixels[right].T)) < 0.2
    assert np.abs(np.median(pixels[right], axis=0)).max() < 0.06


def test_relief_is_really_seen(scene: Scene) -> None:
    hilly = replace(scene, relief=1.0)
    here, there = same_points(hilly.picture(NORTH, 0), hilly.picture(SOUTH, 1))
    flat = scene.ground_from_pixels(NORTH, here) - scene.ground_from_pixels(SOUTH, there)
    assert np.median(np.hypot(*flat.T)) > 3 * 60 / scene.camera.lens.focal_px


def test_places_and_pixels_go_both_ways_on_hills(scene: Scene) -> None:
    hills = replace(scene, relief=0.3)
    pixels = np.array([[50.0, 60.0], [320.0, 200.0], [600.0, 400.0]])
    back = hills.pixels_from_ground(NORTH, hills.ground_from_pixels(NORTH, pixels))
    assert np.allclose(back, pixels, atol=0.2)


def test_a_frame_is_its_seed_and_index(scene: Scene) -> None:
    first, again, other = (scene.picture(NORTH, index) for index in (0, 0, 1))
    assert np.array_equal(first, again)
    assert 0.5 < np.std(first.astype(float) - other.astype(float)) < 5


def test_the_sky_is_pale_blue_and_the_ground_is_not(scene: Scene) -> None:
    picture = scene.picture(OBLIQUE, 0).astype(float)
    sky, ground = picture[:10].mean((0, 1)), picture[-100:].mean((0, 1))
    assert sky[0] > sky[2] + 20
    assert sky.mean() > 130
    assert ground[0] < ground[1] + 10
    assert ground.mean() < 150
    assert np.isnan(scene.ground_from_pixels(OBLIQUE, np.array([[320.0, 5.0]]))).all()


def test_corners_are_darker_by_the_vignetting(scene: Scene) -> None:
    lens = Lens(width=320, height=240)
    plain, dark = (
        Scene(world=scene.world, camera=Camera(lens=lens, noise=0, vignetting=share)).picture(NORTH, 0).astype(float)
        for share in (0.0, 0.5)
    )
    ratio = dark.sum(2) / plain.sum(2)
    assert ratio[120, 160] == pytest.approx(1, abs=0.02)
    assert ratio[0, 0] == pytest.approx(0.5, abs=0.05)


def test_exposure_varies_only_when_asked(scene: Scene) -> None:
    camera = Camera(lens=Lens(width=160, height=120), noise=0)
    steady, wild = (replace(scene, camera=replace(camera, exposure=change)) for change in (0.0, 0.2))
    assert np.std([steady.picture(NORTH, k).mean() for k in range(4)]) == 0
    assert np.std([wild.picture(NORTH, k).mean() for k in range(4)]) > 5


def test_automatic_exposure_darkens_every_other_run_of_frames_by_its_step(scene: Scene) -> None:
    camera = Camera(lens=Lens(width=160, height=120), noise=0, exposure_step=2, step_every=3)
    stepping = replace(scene, camera=camera)
    assert [stepping.gain(k) for k in range(8)] == [1, 1, 1, 0.5, 0.5, 0.5, 1, 1]
    bright, dark = (stepping.picture(NORTH, k).astype(float) for k in (0, 3))
    assert bright.mean() / dark.mean() == pytest.approx(2, abs=0.02)


def test_the_gain_told_is_the_gain_of_the_picture(scene: Scene) -> None:
    wild = replace(scene, camera=Camera(lens=Lens(width=160, height=120), noise=0, exposure=0.2))
    steady = replace(wild, camera=replace(wild.camera, exposure=0.0)).picture(NORTH, 0).mean()
    told = [wild.gain(k) for k in range(4)]
    assert [wild.picture(NORTH, k).mean() / steady for k in range(4)] == pytest.approx(told, rel=0.02)
    assert np.std(told) > 0.05


def test_the_file_is_a_jpeg_of_the_picture(scene: Scene) -> None:
    decoded = sure(cv2.imdecode(np.frombuffer(scene.encoded(NORTH, 0), np.uint8), cv2.IMREAD_COLOR))
    assert np.abs(decoded.astype(float) - scene.picture(NORTH, 0)).mean() < 4
