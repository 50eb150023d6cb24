"""A camera over a plane: round trips and known places."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_mosaic.stitch.camera import geometry
from gcs_mosaic.stitch.camera.geometry import Camera, Pose

poses = st.builds(
    Pose,
    x=st.floats(-1e5, 1e5),
    y=st.floats(-1e5, 1e5),
    log_gsd=st.floats(-1.5, 1.5),
    yaw=st.floats(-4, 4),
    pitch=st.floats(-0.5, 0.5),
    roll=st.floats(-0.5, 0.5),
)
cameras = st.builds(
    Camera,
    st.just(4000),
    st.just(3000),
    st.floats(1, 3),
    *(st.floats(a, b) for a, b in ((-0.12, 0.2), (-0.05, 0.05), (-0.05, 0.05), (-0.05, 0.05))),
)


@given(poses, cameras)
def test_pixels_come_back_from_the_canvas(pose: Pose, camera: Camera) -> None:
    pixels = geometry.pixel_grid(camera, 9, 7)
    places = geometry.canvas_from_pixels(pose, camera, pixels)
    seen = np.isfinite(places).all(axis=1)
    back = geometry.pixels_from_canvas(pose, camera, places[seen])
    assert np.allclose(back, pixels[seen], atol=1e-4)


@given(poses)
def test_a_rotation_is_a_rotation(pose: Pose) -> None:
    rotation = pose.rotation()
    assert np.allclose(rotation @ rotation.T, np.eye(3))
    assert math.isclose(np.linalg.det(rotation), 1)


def test_a_level_frame_lies_on_the_canvas_pixel_by_pixel() -> None:
    camera = Camera(400, 300)
    pixels = geometry.pixel_grid(camera, 5, 4)
    places = geometry.canvas_from_pixels(Pose(*camera.centre), camera, pixels)
    assert np.allclose(places, pixels)


def test_without_a_lens_the_homography_is_the_whole_truth() -> None:
    camera, pose = Camera(4000, 3000, focal=1.2), Pose(100, 200, 0.3, 0.7, 0.1, -0.2)
    pixels = geometry.pixel_grid(camera, 9, 7)
    mapped = np.c_[pixels, np.ones(len(pixels))] @ geometry.canvas_from_frame(pose, camera).T
    assert np.allclose(mapped[:, :2] / mapped[:, 2:], geometry.canvas_from_pixels(pose, camera, pixels))


@pytest.mark.parametrize("tilt_deg", [70, 85])
def test_pixels_above_the_horizon_lie_nowhere(tilt_deg: float) -> None:
    camera = Camera(400, 300, focal=1.2)
    places = geometry.canvas_from_pixels(
        Pose(0, 0, roll=math.radians(tilt_deg)), camera, geometry.pixel_grid(camera, 3, 9)
    )
    assert np.isnan(places).any()
    assert np.isfinite(places).any()


def test_a_lens_that_folds_the_picture_shows_nothing_beyond_the_fold() -> None:
    camera = Camera(4000, 3000, focal=0.6, k1=-0.4)
    corner = geometry.canvas_from_pixels(Pose(0, 0), camera, np.array([[0.0, 0.0]]))
    assert np.isnan(corner).all()


@pytest.mark.parametrize(
    ("k1", "k2", "reach"), [(-1 / 3, 0, 1), (0, -0.2, 1), (0.1, 0.1, math.inf), (-0.5, 0.3, math.inf)]
)
def test_how_far_a_lens_reaches(k1: float, k2: float, reach: float) -> None:
    camera = Camera(4000, 3000, 1.0, k1, k2)
    assert math.isclose(camera.reach, reach)
    radii = np.linspace(0, min(camera.reach, 3), 200)[:-1]
    along, _ = geometry.distort(camera, np.stack([radii, np.zeros_like(radii)]))
    assert (np.diff(along) > 0).all()


@pytest.mark.parametrize("lens", [(1.04, 0.0, 0.0), (0.77, 0.0, 0.0), (0.65, 0.08, 0.008), (0.9, -0.04, 0.001)])
def test_a_fisheye_bends_the_angles_to_its_axis(lens: tuple[float, float, float]) -> None:
    camera = Camera(4000, 3000, *lens, fisheye=True)
    angles = np.linspace(0, 1.3, 50)
    rays = np.stack([np.zeros(50), np.tan(angles)])
    along = geometry.distort(camera, rays)
    assert np.allclose(along[1], angles * (1 + camera.k1 * angles**2 + camera.k2 * angles**4))
    assert np.allclose(geometry.undistort(camera, along), rays, rtol=1e-6)
    beyond = geometry.undistort(camera, np.array([[0.0], [2.2]]))
    assert np.isnan(beyond).all()  # more than 90 degrees from the axis


@given(poses, st.floats(0.5, 2), st.floats(-3, 3))
def test_moving_a_pose_moves_all_it_sees(pose: Pose, scale: float, angle: float) -> None:
    camera, shift = Camera(4000, 3000, 1.4, -0.05), np.array([300.0, -70.0])
    pixels = geometry.pixel_grid(camera, 4, 3)
    before = geometry.canvas_from_pixels(pose, camera, pixels)
    after = geometry.canvas_from_pixels(geometry.moved_by_similarity(pose, scale, angle, shift), camera, pixels)
    c, s = math.cos(angle), math.sin(angle)
    expected = scale * before @ np.array([[c, s], [-s, c]]) + shift
    assert np.allclose(after, expected, rtol=1e-7, atol=1e-4, equal_nan=True)


def test_ground_sampling_distance_grows_with_height() -> None:
    camera = Camera(400, 300)
    middle = camera.centre[None]
    low, high = (geometry.ground_sampling_distance(Pose(0, 0, math.log(h)), camera, middle)[0] for h in (1, 3))
    assert math.isclose(low, 1, rel_tol=1e-6)
    assert math.isclose(high, 3, rel_tol=1e-6)


@given(poses)
def test_a_pose_comes_back_from_its_homography(pose: Pose) -> None:
    camera = Camera(4000, 3000, 1.3)
    found = geometry.pose_from_homography(geometry.pinhole_homography(pose, camera), camera)
    assert found is not None
    grid = geometry.pixel_grid(camera, 5, 4)
    places = geometry.canvas_from_pixels(pose, camera, grid)
    seen = np.isfinite(places).all(axis=1)
    assert np.allclose(geometry.pixels_from_canvas(found, camera, places[seen]), grid[seen], atol=1e-3)
