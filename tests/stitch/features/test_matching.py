"""The matrix product finds what an exhaustive search finds."""

import cv2
import numpy as np
from stitch_ground import Image

from gcs_mosaic.stitch.features.matching import match

RATIO = 0.85


def descriptors(count: int, seed: int) -> Image:
    raw = np.random.default_rng(seed).gamma(0.5, size=(count, 128))
    return np.asarray(np.rint(255 * np.sqrt(raw / raw.sum(axis=1, keepdims=True))), np.uint8)


def test_it_agrees_with_the_exhaustive_matcher() -> None:
    a, b = descriptors(300, 1), descriptors(400, 2)
    b[:120] = np.clip(a[:120].astype(int) + np.random.default_rng(3).integers(-9, 9, (120, 128)), 0, 255)
    matcher = cv2.BFMatcher(cv2.NORM_L2)
    forward = matcher.knnMatch(a.astype(np.float32), b.astype(np.float32), k=2)
    backward = matcher.match(b.astype(np.float32), a.astype(np.float32))
    expected = {
        (m.queryIdx, m.trainIdx)
        for m, second in forward
        if m.distance < RATIO * second.distance and backward[m.trainIdx].trainIdx == m.queryIdx
    }
    assert {tuple(pair) for pair in match(a, b, RATIO)} == expected
    assert len(expected) >= 120


def test_unrelated_descriptors_hardly_match() -> None:
    assert len(match(descriptors(300, 4), descriptors(300, 5), RATIO)) < 30


def test_too_few_to_compare() -> None:
    assert match(descriptors(1, 1), descriptors(9, 2), RATIO).shape == (0, 2)
