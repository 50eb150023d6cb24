"""Faint pictures are brought out; those with enough to see stay as they are."""

import faint_frames
import numpy as np
import pytest

from gcs_mosaic.stitch.matching.detectors import detect
from gcs_mosaic.stitch.matching.features import FeatureSettings, extract, root_sift
from gcs_mosaic.stitch.matching.registration import Registration, RegistrationSettings, register


def motion(a, b):
    """How far the middle of one frame lies from itself in another; None if they do not match."""
    found = register(a, b, RegistrationSettings())
    return (found.pixels_b - found.pixels_a).mean(axis=0) if isinstance(found, Registration) else None


def ordinary(image):
    found = detect(image, "sift", 2000, 0.01)
    return found.points.astype(np.float32), root_sift(found.descriptors)


def test_a_picture_with_enough_to_see_is_left_exactly_as_it_is(ground):
    features = extract(ground[:600, :800], FeatureSettings())
    points, descriptors = ordinary(ground[:600, :800])
    assert features.faint is None
    assert np.array_equal(features.points, points)
    assert np.array_equal(features.descriptors, descriptors)


@pytest.mark.parametrize(("contrast", "noise"), [(2.0, 3.0), (1.0, 0.3)])
def test_faint_ground_is_found_again(contrast, noise):
    scene = faint_frames.scene()
    a, b = (extract(faint_frames.frame(scene, x, 50, x, contrast, noise), FeatureSettings()) for x in (100, 180))
    assert a.faint is not None
    assert motion(a, b) == pytest.approx([-80, 0], abs=1)


def test_without_evening_out_it_would_not_be():
    scene = faint_frames.scene()
    a, b = (ordinary(faint_frames.frame(scene, x, 50, x)) for x in (100, 180))
    close = np.linalg.norm(a[0][:, None] - [80, 0] - b[0][None], axis=2).min(axis=1) < 1
    assert close.mean() < 0.3


def test_sixteen_bits_are_evened_out_before_they_are_rounded_to_eight():
    """A fire takes the range of counts: in eight bits the ground beside it would be one grey."""
    scene = faint_frames.scene()

    def thermal(x):
        counts = 20_000 + 20 * scene[50:350, x : x + 400] + np.random.default_rng(x).normal(0, 2, (300, 400))
        counts[:20] = 60_000
        return np.rint(counts).astype(np.uint16)

    a, b = (extract(thermal(x), FeatureSettings()) for x in (100, 180))
    assert motion(a, b) == pytest.approx([-80, 0], abs=1)


def test_nothing_to_see_stays_nothing():
    assert len(extract(np.full((300, 400), 90, np.uint8), FeatureSettings())) == 0
