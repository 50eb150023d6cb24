"""Faint pictures are brought out; those with enough to see stay as they are."""

import cv2
import faint_frames
import numpy as np
import pytest
from faint_frames import motion
from numpy.typing import NDArray
from stitch_ground import Image

from gcs_mosaic.stitch.camera.dead_border import DeadBorder
from gcs_mosaic.stitch.features.detectors import detect
from gcs_mosaic.stitch.features.extraction import FeatureSettings, extract, faint_features, root_sift, without_border

SIZES = (2, 4, 8, 16, 32)  # px of what there is to see


def ordinary(image: Image) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    found = detect(image, "sift", 2000, 0.01)
    return found.points.astype(np.float32), root_sift(found.descriptors)


def test_a_picture_with_enough_to_see_is_left_exactly_as_it_is(ground: Image) -> None:
    features = extract(ground[:600, :800], FeatureSettings())
    points, descriptors = ordinary(ground[:600, :800])
    assert features.faint is None
    assert np.array_equal(features.points, points)
    assert np.array_equal(features.descriptors, descriptors)


@pytest.mark.parametrize(("contrast", "noise"), [(2.0, 3.0), (1.0, 0.3)])
def test_faint_ground_is_found_again(contrast: float, noise: float) -> None:
    scene = faint_frames.scene()
    a, b = (extract(faint_frames.frame(scene, x, 50, x, contrast, noise), FeatureSettings()) for x in (100, 180))
    assert a.faint is not None
    assert motion(a, b) == pytest.approx([-80, 0], abs=1)


def test_without_evening_out_it_would_not_be() -> None:
    scene = faint_frames.scene()
    a, b = (ordinary(faint_frames.frame(scene, x, 50, x)) for x in (100, 180))
    close = np.linalg.norm(a[0][:, None] - [80, 0] - b[0][None], axis=2).min(axis=1) < 1
    assert close.mean() < 0.3


def test_sixteen_bits_are_evened_out_before_they_are_rounded_to_eight() -> None:
    """A fire takes the range of counts: in eight bits the ground beside it would be one grey."""
    scene = faint_frames.scene()

    def thermal(x: int) -> NDArray[np.uint16]:
        counts = 20_000 + 20 * scene[50:350, x : x + 400] + np.random.default_rng(x).normal(0, 2, (300, 400))
        counts[:20] = 60_000
        return np.asarray(np.rint(counts), np.uint16)

    a, b = (extract(thermal(x), FeatureSettings()) for x in (100, 180))
    assert motion(a, b) == pytest.approx([-80, 0], abs=1)


def test_nothing_to_see_stays_nothing() -> None:
    assert len(extract(np.full((300, 400), 90, np.uint8), FeatureSettings())) == 0


def test_a_faint_frame_matches_one_that_is_just_not_faint() -> None:
    ground = np.random.default_rng(1)
    cells = [
        cv2.resize(ground.normal(size=(1000 // c + 2,) * 2), (1000, 1000), interpolation=cv2.INTER_CUBIC) for c in SIZES
    ]
    levels = np.sum(cells, axis=0) / np.std(np.sum(cells, axis=0))

    def shot(x: int, contrast: float) -> Image:
        noise = np.random.default_rng(x).normal(0, 0.3, (600, 800))
        seen = 128 + contrast * levels[300:900, x : x + 800] + noise
        return np.asarray(np.clip(np.rint(seen), 0, 255), np.uint8)

    faint, ordinary_one = (extract(shot(*of), FeatureSettings()) for of in ((20, 2.5), (170, 3.2)))
    assert faint.faint is not None
    assert ordinary_one.faint is None
    assert motion(faint, ordinary_one) == pytest.approx([-150, 0], abs=1)


def test_a_dead_border_is_left_out_of_what_was_brought_out() -> None:
    scene, dead = faint_frames.scene(), DeadBorder(top=60)
    features = without_border(extract(faint_frames.frame(scene, 100, 50, 1), FeatureSettings()), dead)
    assert features.faint is not None
    again = faint_features(features.faint, features, FeatureSettings())
    assert min(features.points[:, 1].min(), again.points[:, 1].min()) > 60
    assert features.ordinary <= len(features)
