"""Pixels tell whether two frames show one ground where keypoints cannot; what chance gives is no evidence."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from faint_frames import frame, scene
from stitch_ground import SMALL_CAMERA, Image, photograph

from gcs_mosaic.stitch.arrays import Array, Matrix3x3
from gcs_mosaic.stitch.camera.dead_border import DeadBorder
from gcs_mosaic.stitch.camera.geometry import Pose, canvas_from_pixels, pixel_grid, pixels_from_canvas
from gcs_mosaic.stitch.features.extraction import Features, FeatureSettings, extract
from gcs_mosaic.stitch.registration.agreement import PixelPair
from gcs_mosaic.stitch.registration.outcome import NotRegistered, Registration
from gcs_mosaic.stitch.registration.patches import patches
from gcs_mosaic.stitch.registration.proposals import Proposal
from gcs_mosaic.stitch.registration.registration import register
from gcs_mosaic.stitch.registration.settings import RegistrationSettings

SETTINGS = RegistrationSettings()
HERE, THERE = Pose(700, 700), Pose(820, 750, 0.1, 0.2)


def seen(ground: Image, pose: Pose) -> Features:
    return extract(photograph(ground, pose, SMALL_CAMERA), FeatureSettings())


def true_places(pixels: Array, here: Pose = HERE, there: Pose = THERE) -> Array:
    return pixels_from_canvas(there, SMALL_CAMERA, canvas_from_pixels(here, SMALL_CAMERA, pixels))


def true_homography(here: Pose = HERE, there: Pose = THERE) -> Matrix3x3:
    grid = pixel_grid(SMALL_CAMERA, 5, 5)
    return np.asarray(cv2.findHomography(grid, true_places(grid, here, there), 0)[0])


def moved(x: float, y: float) -> Matrix3x3:
    return np.array([[1, 0, x], [0, 1, y], [0, 0, 1.0]])


def off(found: Matrix3x3) -> float:
    """Pixels by which a homography lays the middle of the overlap elsewhere than it is."""
    inside = pixel_grid(SMALL_CAMERA, 9, 9)[36:45]
    laid = cv2.perspectiveTransform(inside[None], found)[0]
    return float(np.median(np.linalg.norm(laid - true_places(inside), axis=1)))


@pytest.mark.parametrize("astray", [0.0, 12.0, 24.0])
def test_a_proposal_that_is_some_pixels_off_is_drawn_to_the_ground(ground: Image, astray: float) -> None:
    pair = PixelPair(seen(ground, HERE), seen(ground, THERE))
    found = pair.agreement(moved(astray, -astray / 2) @ true_homography())
    assert found is not None
    assert found.evidence > 6
    assert found.correlation > 0.8
    assert off(found.b_from_a) < 1.0


def test_other_ground_is_no_evidence(ground: Image, other_ground: Image) -> None:
    """Of 40 proposals of pairs that share nothing, one in a hundred may reach two decades."""
    a, b = seen(ground, HERE), seen(other_ground, Pose(600, 600))
    pair, rng = PixelPair(a, b), np.random.default_rng(0)
    found = [pair.agreement(moved(*rng.uniform(-150, 150, 2))) for _ in range(40)]
    assert max((one.evidence for one in found if one), default=0.0) < 3


def test_rows_that_repeat_themselves_are_no_evidence() -> None:
    """The same rows one row off agree as well: their second peak says so."""
    _, x = np.mgrid[:300, :400]
    rows = np.sin(2 * np.pi * x / 16)[None] * np.ones((2, 1, 1))
    noise = np.random.default_rng(0).normal(0, 0.05, rows.shape)
    a, b = (extract(np.clip(128 + 80 * one, 0, 255).astype(np.uint8), FeatureSettings()) for one in rows + noise)
    found = PixelPair(a, b).agreement(moved(16, 30))
    assert found is None or found.evidence < 1


def test_what_agrees_at_zero_motion_is_believed_only_where_it_is_the_ground() -> None:
    """A sensor's pattern shared by two frames of different fields; and a hover."""
    fields, pattern = scene(), 4.0 * scene(seed=9)[:300, :400]
    one, other, again = (
        extract(frame(fields, *place, seed=k, pattern=pattern), FeatureSettings())
        for k, place in enumerate([(100, 100), (600, 700), (100, 100)])
    )
    assert PixelPair(one, other).agreement(np.eye(3)) is None
    hover = PixelPair(one, again).agreement(np.eye(3))
    assert hover is not None
    assert hover.evidence > 6


def test_a_dead_border_takes_no_part(ground: Image) -> None:
    a, b = seen(ground, HERE), seen(ground, Pose(700, 1600))
    bar = np.random.default_rng(0).integers(-100, 100, (40, 1), dtype=np.int8)
    barred = []
    for one in (a, b):
        assert one.texture is not None
        texture = one.texture.copy()
        texture[:40] = bar
        barred.append(replace(one, kept_texture=texture, dead=DeadBorder(top=40)))
    found = PixelPair(*barred).agreement(moved(0, 0))
    assert found is None or found.evidence < 3


def test_look_alikes_have_nothing_in_common_beyond_what_matched(ground: Image) -> None:
    """One object in two places: its pixels agree, those around it do not."""
    a, b = seen(ground, HERE), seen(ground, Pose(1500, 1600))
    assert a.texture is not None
    assert b.texture is not None
    texture = b.texture.copy()
    texture[100:160, 100:180] = a.texture[100:160, 100:180]
    here, there = a, replace(b, kept_texture=texture)
    pair = PixelPair(here, there)
    found = pair.agreement(moved(3, 0))
    grid = np.stack(np.meshgrid(np.arange(100, 180, 8), np.arange(100, 160, 8)), -1).reshape(-1, 2).astype(float)
    scale = a.width / a.texture.shape[1]
    assert found is None or pair.evidence_beyond(found, grid * scale) < SETTINGS.least_beyond


def test_without_keypoints_the_expected_place_is_enough(ground: Image) -> None:
    """As the flight's last motion or the neighbours' poses tell it; and nothing is registered there that shows other ground."""
    a, b = seen(ground, HERE), seen(ground, THERE)
    none = np.empty((0, 2), np.float32), np.empty((0, 128), np.uint8)
    bare = replace(a, kept_points=none[0], kept_descriptors=none[1])
    expected = [Proposal(moved(8, 8) @ true_homography(), 2.0)]
    found = register(bare, b, SETTINGS, expected=expected)
    assert isinstance(found, Registration)
    assert len(found.features) == 0
    assert found.independent_inliers >= 8
    wrong = np.linalg.norm(true_places(found.pixels_a) - found.pixels_b, axis=1)
    assert np.median(wrong) < 1.0
    elsewhere = seen(ground, Pose(1700, 1700))
    assert isinstance(register(bare, elsewhere, SETTINGS, expected=expected), NotRegistered)


def test_frames_without_a_picture_are_judged_by_keypoints_alone(ground: Image) -> None:
    a, b = (replace(seen(ground, pose), kept_texture=None) for pose in (HERE, THERE))
    assert isinstance(register(a, b, SETTINGS), Registration)
    assert isinstance(register(a, replace(seen(ground, Pose(1700, 1700)), kept_texture=None), SETTINGS), NotRegistered)


def test_patches_lie_where_the_ground_is(ground: Image) -> None:
    found = patches(seen(ground, HERE), seen(ground, THERE), moved(4, -3) @ true_homography())
    assert len(found.pixels_a) >= 12
    assert len(found.pixels_a) <= found.tried
    wrong = np.linalg.norm(true_places(found.pixels_a) - found.pixels_b, axis=1)
    assert np.quantile(wrong, 0.9) < 1.0


def test_patches_lie_where_the_ground_is_to_a_fraction_of_a_pixel(ground: Image) -> None:
    """Whole pixels of the texture would be off by 0.29 px across and as much along."""
    a, b = seen(ground, HERE), seen(ground, THERE)
    assert a.texture is not None
    scale, wrong = SMALL_CAMERA.width / a.texture.shape[1], list[Array]()
    for part in (0.0, 0.3, 0.5, 0.8):
        found = patches(a, b, moved(part * scale, -part * scale) @ true_homography())
        wrong.append(true_places(found.pixels_a) - found.pixels_b)
    assert np.sqrt(np.square(np.concatenate(wrong)).mean(axis=0)).max() < 0.15 * scale


def test_a_pair_is_judged_alike_each_time(ground: Image) -> None:
    pairs = [PixelPair(seen(ground, HERE), seen(ground, THERE)).agreement(true_homography()) for _ in range(2)]
    assert pairs[0] is not None
    assert pairs[1] is not None
    assert pairs[0].evidence == pairs[1].evidence
    assert np.array_equal(pairs[0].b_from_a, pairs[1].b_from_a)
