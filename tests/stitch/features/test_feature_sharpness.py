"""Sharpness tells a blurred picture from the same one in focus, and nothing else."""

import cv2
import numpy as np
import pytest
from stitch_ground import Image

from gcs_mosaic.stitch.features.extraction import FeatureSettings, extract
from gcs_mosaic.stitch.features.sharpness import sharpness


@pytest.fixture(scope="module")
def picture(ground: Image) -> Image:
    return ground[300:900, 400:1200]


@pytest.mark.parametrize("smear", [(5, 1), (1, 5)])
def test_a_smear_in_either_direction_is_seen(picture: Image, smear: tuple[int, int]) -> None:
    assert sharpness(picture) > 1.3 * sharpness(cv2.blur(picture, smear))


def test_more_blur_is_less_sharp(picture: Image) -> None:
    found = [sharpness(cv2.GaussianBlur(picture, (0, 0), sigma)) for sigma in (0.5, 0.8, 1.2, 2.0)]
    assert found == sorted(found, reverse=True)


def test_light_depth_and_colour_do_not_count(picture: Image) -> None:
    plain = sharpness(picture)
    assert sharpness(picture.astype(np.uint16) * 200) == pytest.approx(plain, rel=1e-3)
    assert sharpness(cv2.convertScaleAbs(picture, alpha=0.6)) == pytest.approx(plain, rel=0.05)
    assert sharpness(cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR)) == pytest.approx(plain)


def test_burnt_in_writing_does_not_hide_a_blur(picture: Image) -> None:
    blurred = cv2.blur(picture, (5, 5))
    for y in range(40, 600, 200):
        cv2.putText(blurred, "12:00:00 100 m", (10, y), cv2.FONT_HERSHEY_SIMPLEX, 1, 255, 2)
    assert sharpness(picture) > 1.3 * sharpness(blurred)


@pytest.mark.parametrize("shape", [(1, 1), (5, 400), (400, 5), (40, 40, 3)])
def test_small_and_even_pictures_have_none(shape: tuple[int, ...]) -> None:
    assert sharpness(np.full(shape, 7, np.uint8)) == 0


def test_features_carry_it(picture: Image) -> None:
    assert extract(picture, FeatureSettings()).sharpness == sharpness(picture)
