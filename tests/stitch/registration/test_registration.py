"""Two frames of one ground are registered, two of different ground are not."""

import math

import numpy as np
import pytest
from stitch_ground import SMALL_CAMERA, Image, photograph

from gcs_mosaic.stitch.camera.geometry import Pose, canvas_from_pixels, pixels_from_canvas
from gcs_mosaic.stitch.features.extraction import Features, FeatureSettings, extract
from gcs_mosaic.stitch.registration.frame_pair import independent_count
from gcs_mosaic.stitch.registration.outcome import NotRegistered, Registration, well_spread
from gcs_mosaic.stitch.registration.registration import register
from gcs_mosaic.stitch.registration.settings import RegistrationSettings

SETTINGS = RegistrationSettings()


def features_at(ground: Image, pose: Pose) -> Features:
    return extract(photograph(ground, pose, SMALL_CAMERA), FeatureSettings())


def test_overlapping_frames_agree_with_the_truth(ground: Image) -> None:
    here, there = Pose(700, 700), Pose(900, 760, 0.3, 0.5, 0.1, 0.05)
    found = registered(features_at(ground, here), features_at(ground, there))
    true_b = pixels_from_canvas(there, SMALL_CAMERA, canvas_from_pixels(here, SMALL_CAMERA, found.pixels_a))
    assert np.median(np.linalg.norm(found.pixels_b - true_b, axis=1)) < 0.7


def test_frames_of_other_ground_are_not_registered(ground: Image, other_ground: Image) -> None:
    found = register(features_at(ground, Pose(700, 700)), features_at(other_ground, Pose(600, 600)), SETTINGS)
    assert isinstance(found, NotRegistered)
    assert found.reason


def test_the_other_frame_sees_the_same_registration_turned(ground: Image) -> None:
    here, there = features_at(ground, Pose(700, 700)), features_at(ground, Pose(820, 700))
    found = registered(here, there)
    turned = found.turned()
    assert np.array_equal(turned.pixels_a, found.pixels_b)
    assert np.allclose(turned.b_from_a @ found.b_from_a, np.eye(3))
    assert turned.turned().evidence == found.evidence


def with_writing(features: Features, lines: Features) -> Features:
    """The frame with something burnt in, as a camera writes height and time into its pictures."""
    return Features(
        np.concatenate([lines.points, features.points]),
        np.concatenate([lines.descriptors, features.descriptors]),
        features.width,
        features.height,
        features.scale,
    )


def registered(a: Features, b: Features, settings: RegistrationSettings = SETTINGS) -> Registration:
    found = register(a, b, settings)
    assert isinstance(found, Registration)
    return found


@pytest.fixture
def writing(other_ground: Image) -> Features:
    """Features of something in the lower left of every frame."""
    found = features_at(other_ground, Pose(600, 600))
    inside = ((found.points > [20, 240]) & (found.points < [160, 340])).all(axis=1)
    return Features(found.points[inside], found.descriptors[inside], found.width, found.height, found.scale)


def test_what_is_burnt_into_every_frame_is_no_common_ground(ground: Image, writing: Features) -> None:
    here, there = (with_writing(features_at(ground, pose), writing) for pose in (Pose(400, 400), Pose(1500, 1500)))
    refused = register(here, there, SETTINGS)
    assert isinstance(refused, NotRegistered)
    assert "of the overlap agrees" in refused.reason
    assert isinstance(register(here, there, RegistrationSettings(least_confirmed=0)), Registration)


def test_the_ground_is_found_beneath_what_is_burnt_in(ground: Image, writing: Features) -> None:
    """Little overlap: more matches agree on the writing than on the ground."""
    here, there = Pose(700, 700), Pose(1080, 940)
    a, b = (with_writing(features_at(ground, pose), writing) for pose in (here, there))
    mistaken = registered(a, b, RegistrationSettings(least_confirmed=0))
    assert np.allclose(mistaken.b_from_a, np.eye(3), atol=0.05)
    found = registered(a, b)
    true_b = pixels_from_canvas(there, SMALL_CAMERA, canvas_from_pixels(here, SMALL_CAMERA, found.pixels_a))
    assert np.median(np.linalg.norm(found.pixels_b - true_b, axis=1)) < 0.7


def test_a_mirrored_frame_is_not_registered(ground: Image) -> None:
    frame = photograph(ground, Pose(700, 700), SMALL_CAMERA)
    found = register(extract(frame, FeatureSettings()), extract(frame[:, ::-1].copy(), FeatureSettings()), SETTINGS)
    assert isinstance(found, NotRegistered)


def test_a_change_of_scale_beyond_belief_is_refused(ground: Image) -> None:
    low, high = features_at(ground, Pose(1200, 1200)), features_at(ground, Pose(1200, 1200, math.log(1.8)))
    assert isinstance(register(low, high, SETTINGS), Registration)
    assert isinstance(register(low, high, RegistrationSettings(largest_zoom=1.5)), NotRegistered)


def test_features_on_one_spot_count_once() -> None:
    spot = np.random.default_rng(0).uniform(2, 14, (50, 2))
    assert independent_count(spot, np.random.default_rng(1).uniform(0, 500, (50, 2)), cell=16) == 1


def test_well_spread_points_reach_the_corners() -> None:
    points = np.random.default_rng(0).uniform(0, 1, (500, 2))
    chosen = points[well_spread(points, 8)]
    assert len(chosen) == 8
    for corner in ([0, 0], [0, 1], [1, 0], [1, 1]):
        assert np.linalg.norm(chosen - corner, axis=1).min() < 0.2
