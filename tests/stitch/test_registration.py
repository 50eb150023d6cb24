"""Two frames of one ground are registered, two of different ground are not."""

import math

import numpy as np
from stitch_ground import SMALL_CAMERA, photograph

from gcs_mosaic.stitch.features import FeatureSettings, extract
from gcs_mosaic.stitch.geometry import Pose, canvas_from_pixels, pixels_from_canvas
from gcs_mosaic.stitch.registration import (
    NotRegistered,
    Registration,
    RegistrationSettings,
    independent_count,
    register,
    well_spread,
)

SETTINGS = RegistrationSettings()


def features_at(ground, pose):
    return extract(photograph(ground, pose, SMALL_CAMERA), FeatureSettings())


def test_overlapping_frames_agree_with_the_truth(ground):
    here, there = Pose(700, 700), Pose(900, 760, 0.3, 0.5, 0.1, 0.05)
    found = register(features_at(ground, here), features_at(ground, there), SETTINGS)
    assert isinstance(found, Registration)
    true_b = pixels_from_canvas(there, SMALL_CAMERA, canvas_from_pixels(here, SMALL_CAMERA, found.pixels_a))
    assert np.median(np.linalg.norm(found.pixels_b - true_b, axis=1)) < 0.7


def test_frames_of_other_ground_are_not_registered(ground, other_ground):
    found = register(features_at(ground, Pose(700, 700)), features_at(other_ground, Pose(600, 600)), SETTINGS)
    assert isinstance(found, NotRegistered)
    assert found.reason


def test_a_mirrored_frame_is_not_registered(ground):
    frame = photograph(ground, Pose(700, 700), SMALL_CAMERA)
    found = register(extract(frame, FeatureSettings()), extract(frame[:, ::-1].copy(), FeatureSettings()), SETTINGS)
    assert isinstance(found, NotRegistered)


def test_a_change_of_scale_beyond_belief_is_refused(ground):
    low, high = features_at(ground, Pose(1200, 1200)), features_at(ground, Pose(1200, 1200, math.log(1.8)))
    assert isinstance(register(low, high, SETTINGS), Registration)
    assert isinstance(register(low, high, RegistrationSettings(largest_zoom=1.5)), NotRegistered)


def test_features_on_one_spot_count_once():
    spot = np.random.default_rng(0).uniform(2, 14, (50, 2))
    assert independent_count(spot, np.random.default_rng(1).uniform(0, 500, (50, 2)), cell=16) == 1


def test_well_spread_points_reach_the_corners():
    points = np.random.default_rng(0).uniform(0, 1, (500, 2))
    chosen = points[well_spread(points, 8)]
    assert len(chosen) == 8
    for corner in ([0, 0], [0, 1], [1, 0], [1, 1]):
        assert np.linalg.norm(chosen - corner, axis=1).min() < 0.2
