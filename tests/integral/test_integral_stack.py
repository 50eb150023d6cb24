"""A point at a height, seen by cameras whose places are known, lies where it is if the focus is at its height."""

import math

import cv2
import numpy as np
import pytest

from gcs_mosaic.integral.aperture import aperture_of
from gcs_mosaic.integral.focal_plane import camera_height, direction_to, pixels_at
from gcs_mosaic.integral.forms import FORMS, looks_of, mean
from gcs_mosaic.integral.stack import GroundLook, GroundWindow, LookStack, laid_together
from gcs_mosaic.stitch.camera.geometry import Camera, Pose
from gcs_mosaic.stitch.camera.relief import ReliefDisplacement

CAMERA = Camera(320, 240, focal=1.45, k1=-0.04)
POSES = [Pose(x, y, 0.0, 0.4 * x / 60, 0.03, -0.02) for x in (-60.0, 0.0, 60.0) for y in (-40.0, 40.0)]
WINDOW = GroundWindow(5.0, -3.0, 100.0, 100)


def ray_through(pose: Pose, pixel: np.ndarray, height: float) -> np.ndarray:
    """Where the ray of an undistorted pixel meets a height: straight from the rotation, without the canvas."""
    ray = pose.rotation() @ [*((pixel - CAMERA.principal_point) / CAMERA.focal_px), 1.0]
    drop = camera_height(pose, CAMERA) - height
    return np.asarray(np.array([pose.x, pose.y]) + drop * ray[:2] / ray[2])


@pytest.mark.parametrize("height", [-30.0, 0.0, 25.0])
def test_a_pixel_sees_the_place_that_its_ray_meets(height: float) -> None:
    straight = Camera(320, 240, focal=1.45)
    for pose in POSES:
        pixel = np.array([201.0, 77.0])
        place = ray_through(pose, pixel, height)
        assert pixels_at(pose, straight, None, place[None], height)[0] == pytest.approx(pixel, abs=1e-6)


def test_above_the_camera_nothing_is_seen() -> None:
    pose = POSES[0]
    above = camera_height(pose, CAMERA)
    assert np.isnan(pixels_at(pose, CAMERA, None, np.zeros((1, 2)), above)).all()
    assert direction_to(pose, CAMERA, np.array([pose.x, pose.y]), 0.0) == pytest.approx([0, 0, 1])


def dotted(pose: Pose, place: np.ndarray, height: float) -> GroundLook:
    """A frame that shows a bright dot at a place in space, and nothing else."""
    image = np.zeros((CAMERA.height, CAMERA.width), np.float32)
    x, y = pixels_at(pose, CAMERA, None, place[None], height)[0]
    columns, rows = np.meshgrid(np.arange(CAMERA.width), np.arange(CAMERA.height))
    image += np.exp(-((columns - x) ** 2 + (rows - y) ** 2) / 2).astype(np.float32) * 100
    return GroundLook(f"{pose.x},{pose.y}", pose, CAMERA, image[..., None])


def brightest_place(values: np.ndarray) -> tuple[float, float]:
    row, column = np.unravel_index(np.nanargmax(values[..., 0]), values.shape[:2])
    return WINDOW.place_of(float(column), float(row))


@pytest.mark.parametrize("height", [-20.0, 0.0, 30.0])
def test_what_is_in_focus_stands_still_and_what_is_not_blurs(height: float) -> None:
    place = np.array([12.3, -8.4])
    looks = [dotted(pose, place, height) for pose in POSES]
    sharp = mean(laid_together(looks, WINDOW, height))
    assert brightest_place(sharp) == pytest.approx(place.tolist(), abs=0.8)
    assert np.nanmax(sharp) > 75  # between pixels bilinear sampling leaves exp(-1/4) of such a dot
    assert np.nanmax(mean(laid_together(looks, WINDOW, height + 40.0))) < 35


def test_a_part_of_a_frame_in_memory_shows_what_the_whole_does() -> None:
    whole = dotted(POSES[2], np.array([5.0, -3.0]), 10.0)
    left, top = 40, 30
    part = GroundLook("part", whole.pose, whole.camera, whole.image[top:200, left:280], left=left, top=top)
    seen, parted = (laid_together([one], WINDOW, 10.0).values for one in (whole, part))
    assert np.nanmax(np.abs(seen - parted)) < 4  # sampled in steps of 1/32 px, and the dot is as steep as 60 a pixel
    halved = np.asarray(cv2.resize(whole.image, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA), np.float32)[
        ..., None
    ]
    coarse = laid_together([GroundLook("half", whole.pose, whole.camera, halved, reduction=2.0)], WINDOW, 10.0).values
    assert brightest_place(coarse[0]) == pytest.approx(brightest_place(seen[0]), abs=1.5)


def test_relief_shifts_the_plane_as_it_shifts_the_ground() -> None:
    shift = np.zeros((5, 5, 2))
    shift[..., 0] = 3.0 / CAMERA.half_diagonal
    relief = ReliefDisplacement.from_grid(shift)
    place = np.array([[10.0, 20.0]])
    moved = pixels_at(POSES[0], CAMERA, relief, place, 15.0) - pixels_at(POSES[0], CAMERA, None, place, 15.0)
    assert moved[0] == pytest.approx([-3.0, 0.0], abs=1e-3)


def stack_of(*values: float) -> LookStack:
    return LookStack([str(one) for one in values], np.array(values, np.float32).reshape(-1, 1, 1, 1))


@pytest.mark.parametrize(
    ("form", "wanted"), [("mean", 4.0), ("median", 2.0), ("min", 1.0), ("max", 9.0), ("deviation", math.sqrt(19))]
)
def test_forms_of_three_looks_and_one_that_sees_nothing(form: str, wanted: float) -> None:
    assert FORMS[form](stack_of(9.0, math.nan, 1.0, 2.0))[0, 0, 0] == pytest.approx(wanted)


@pytest.mark.parametrize("form", sorted(FORMS))
def test_what_was_seen_once_is_not_shown(form: str) -> None:
    assert np.isnan(FORMS[form](stack_of(9.0, math.nan))).all()


def test_an_even_number_of_looks_has_the_mean_of_the_middle_two_as_median() -> None:
    assert FORMS["median"](stack_of(1.0, 2.0, 4.0, 9.0))[0, 0, 0] == 3.0


def test_noise_falls_with_the_number_of_looks() -> None:
    noise = np.random.default_rng(1).standard_normal((16, 64, 64, 1)).astype(np.float32)
    stack = LookStack([str(one) for one in range(16)], noise)
    assert float(mean(stack).std()) == pytest.approx(1 / 4, rel=0.05)
    assert (looks_of(stack) == 16).all()


def test_the_aperture_is_told_by_who_sees_the_place() -> None:
    looks = [dotted(pose, np.zeros(2), 0.0) for pose in POSES]
    told = aperture_of(looks, np.zeros(2), 0.0)
    above = camera_height(POSES[0], CAMERA)
    assert told.looks == 6
    assert told.width == pytest.approx(math.hypot(120, 80))
    assert told.spread_deg == pytest.approx(2 * math.degrees(math.atan(math.hypot(60, 40) / above)), abs=1e-6)
    assert aperture_of(looks, np.array([1e5, 0.0]), 0.0).looks == 0
