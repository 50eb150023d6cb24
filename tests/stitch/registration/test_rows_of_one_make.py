"""Ground of rows of one make: what lies at one place looks as if it lay at many."""

from __future__ import annotations

import itertools

import cv2
import numpy as np
import pytest

from gcs_mosaic.stitch.arrays import FloatImage, ImageBGR
from gcs_mosaic.stitch.features.extraction import Features, FeatureSettings, extract
from gcs_mosaic.stitch.registration.outcome import Registration
from gcs_mosaic.stitch.registration.registration import register
from gcs_mosaic.stitch.registration.settings import RegistrationSettings

HEIGHT, WIDTH = 1500, 3600
NOISE = 2.0  # grey levels of the camera; stones differ by one, grass by two


def graves(seed: int) -> FloatImage:
    """A burial ground: stones 55 px apart in rows 90 px apart, each a little different."""
    rng = np.random.default_rng(seed)
    ground = np.full((HEIGHT, WIDTH, 3), (60, 130, 90), np.float32)
    for size in (2, 6, 20):
        grass = cv2.GaussianBlur(rng.normal(0, 1, (HEIGHT, WIDTH)).astype(np.float32), (0, 0), size)
        ground += (grass / grass.std() * 2 / np.sqrt(3))[..., None]
    for row, column in itertools.product(range(30, HEIGHT - 60, 90), range(20, WIDTH - 40, 55)):
        x, y = column + round(rng.normal(0, 0.5)), row + round(rng.normal(0, 0.5))
        ground[y : y + 34, x : x + 18] = 205 + rng.normal(0, 1, 3)
        ground[y + 34 : y + 40, x + 4 : x + 24] = 35
    return np.asarray(cv2.GaussianBlur(ground, (0, 0), 0.7), np.float32)


def seen(ground: FloatImage, places: list[tuple[int, int]], seed: int) -> list[Features]:
    rng = np.random.default_rng(seed)

    def picture(x: int, y: int) -> ImageBGR:
        noisy = ground[y : y + 480, x : x + 640] + rng.normal(0, NOISE, (480, 640, 3))
        return np.asarray(np.clip(noisy, 0, 255), np.uint8)

    return [extract(picture(x, y), FeatureSettings()) for x, y in places]


@pytest.mark.long
@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.thorough) for seed in (1, 2))])
def test_pictures_that_have_no_ground_in_common_are_not_joined(seed: int) -> None:
    """Of 105 pairs three to eight were, by pixels and by keypoints; with nothing to tell that they lie elsewhere."""
    frames = seen(graves(seed), [(x, y) for y in (0, 510, 1000) for x in (0, 720, 1430, 2200, 2900)], seed)
    pairs = itertools.combinations(frames, 2)
    assert not any(isinstance(register(a, b, RegistrationSettings()), Registration) for a, b in pairs)


@pytest.mark.long
def test_pictures_that_overlap_by_half_are_joined_where_they_lie() -> None:
    for seed in range(3):
        first, *others = seen(graves(seed), [(1430, 510), (1750, 510), (1430, 760), (1210, 420)], seed)
        for frame, (dx, dy) in zip(others, [(320, 0), (0, 250), (-220, -90)], strict=True):
            found = register(first, frame, RegistrationSettings())
            assert isinstance(found, Registration)
            assert np.allclose((found.b_from_a / found.b_from_a[2, 2])[:2, 2], [-dx, -dy], atol=3)
