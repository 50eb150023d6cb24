from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sitl.geometry import (
    Array,
    CameraState,
    Lens,
    ground_from_pixels,
    pixels_from_ground,
    resolution,
    world_from_camera,
)

LENS = Lens(width=640, height=480, k1=-0.08)
CORNERS_AND_MIDDLE = np.array([[0, 0], [639, 0], [639, 479], [0, 479], [319.5, 239.5], [100, 300]], np.float64)
turns = st.floats(-0.4, 0.4)


def looking_down(**changes: float) -> CameraState:
    return CameraState(**{"time": 0.0, "x": 10.0, "y": -20.0, "height": 80.0} | changes)


def bumps(x: Array, y: Array) -> Array:
    return 2 + np.sin(x / 20) + np.cos(y / 15)


@given(yaw=st.floats(-7, 7), pitch=turns, roll=turns)
def test_turning_is_a_rotation(yaw: float, pitch: float, roll: float) -> None:
    rotation = world_from_camera(looking_down(yaw=yaw, pitch=pitch, roll=roll))
    assert np.allclose(rotation @ rotation.T, np.eye(3))
    assert np.linalg.det(rotation) == pytest.approx(1)


@given(yaw=st.floats(-7, 7), pitch=turns, roll=turns, height=st.floats(5, 500))
def test_pixels_to_the_ground_and_back(yaw: float, pitch: float, roll: float, height: float) -> None:
    state = looking_down(yaw=yaw, pitch=pitch, roll=roll, height=height)
    ground = ground_from_pixels(LENS, state, CORNERS_AND_MIDDLE)
    assert np.allclose(pixels_from_ground(LENS, state, ground), CORNERS_AND_MIDDLE, atol=1e-6)


def test_a_level_camera_heading_north_has_north_on_top_and_east_on_the_right() -> None:
    middle, top, right = ground_from_pixels(LENS, looking_down(), np.array([[319.5, 239.5], [319.5, 0], [639, 239.5]]))
    assert np.allclose(middle, [10, -20])
    assert top[1] < -20
    assert top[0] == pytest.approx(10)
    assert right[0] > 10
    assert right[1] == pytest.approx(-20)


def test_heading_east_turns_the_top_of_the_picture_east() -> None:
    (top,) = ground_from_pixels(LENS, looking_down(yaw=np.pi / 2), np.array([[319.5, 0.0]]))
    assert top[0] > 10
    assert top[1] == pytest.approx(-20)


def test_nose_up_looks_ahead_and_right_wing_down_looks_left() -> None:
    centre = np.array([LENS.centre])
    assert np.allclose(ground_from_pixels(LENS, looking_down(pitch=0.1), centre), [[10, -20 - 80 * np.tan(0.1)]])
    assert np.allclose(ground_from_pixels(LENS, looking_down(roll=0.1), centre), [[10 - 80 * np.tan(0.1), -20]])


def test_the_lens_bends_by_its_radial_term() -> None:
    ideal = (CORNERS_AND_MIDDLE - LENS.centre) / LENS.focal_px
    bent = pixels_from_ground(LENS, looking_down(), 80 * ideal + [10, -20])
    expected = ideal * (1 + LENS.k1 * (ideal**2).sum(1, keepdims=True)) * LENS.focal_px + LENS.centre
    assert np.allclose(bent, expected)


def test_above_the_horizon_there_is_no_ground_and_behind_the_camera_no_pixel() -> None:
    tilted = looking_down(pitch=np.radians(75))
    ground = ground_from_pixels(LENS, tilted, np.array([[320.0, 0.0], [320.0, 479.0]]))
    assert np.isnan(ground[0]).all()
    assert np.isfinite(ground[1]).all()
    assert np.isnan(pixels_from_ground(LENS, tilted, np.array([[10.0, 500.0]]))).all()


def test_on_relief_the_place_seen_is_where_its_surface_appears() -> None:
    state = looking_down(pitch=0.1, roll=-0.05)
    place = ground_from_pixels(LENS, state, CORNERS_AND_MIDDLE, bumps)
    back = pixels_from_ground(LENS, state, place, bumps(place[:, 0], place[:, 1]))
    assert np.allclose(back, CORNERS_AND_MIDDLE, atol=1e-3)


def test_resolution_of_a_level_picture_is_height_over_focal_length() -> None:
    found = resolution(LENS, looking_down(), np.array([LENS.centre]))
    assert found[0] == pytest.approx(80 / LENS.focal_px, rel=1e-4)


def test_resolution_grows_coarser_towards_the_horizon() -> None:
    column = np.array([[320.0, y] for y in (479, 350, 220, 120)])
    assert (np.diff(resolution(LENS, looking_down(pitch=np.radians(65)), column)) > 0).all()
