"""Wedges without a picture are found, and ground that is black or white is none."""

import cv2
import numpy as np
import pytest

from gcs_mosaic.stitch.arrays import Bands, Mask
from gcs_mosaic.stitch.features.wedges import area_of
from tests.sure import sure

HEIGHT, WIDTH = 480, 640


def ground(seed: int = 0) -> Bands:
    rng = np.random.default_rng(seed)
    coarse = rng.integers(60, 200, (HEIGHT // 16, WIDTH // 16, 3)).astype(np.uint8)
    fine = cv2.resize(coarse, (WIDTH, HEIGHT), interpolation=cv2.INTER_CUBIC).astype(np.int16)
    return np.asarray(np.clip(fine + rng.normal(0, 4, fine.shape), 1, 254), np.uint8)


def warped(image: Bands, level: int, degrees: float) -> tuple[Bands, Mask, Mask]:
    """Turned about its middle on a ground of one level; which pixels hold a picture, and which hold none, others a part."""
    turn = cv2.getRotationMatrix2D((WIDTH / 2, HEIGHT / 2), degrees, 1.0)
    seen = cv2.warpAffine(image, turn, (WIDTH, HEIGHT), flags=cv2.INTER_CUBIC, borderValue=(level,) * 3)
    holds = cv2.warpAffine(np.full((HEIGHT, WIDTH), 255, np.uint8), turn, (WIDTH, HEIGHT))
    return np.asarray(seen), np.asarray(holds == 255), np.asarray(holds == 0)


def as_jpeg(image: Bands, quality: int = 85) -> Bands:
    _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR))


@pytest.mark.parametrize("jpeg", [False, True])
@pytest.mark.parametrize("level", [0, 255])
@pytest.mark.parametrize("degrees", [-3, 10, 40])
def test_wedges_are_found_and_the_picture_is_kept(degrees: float, level: int, jpeg: bool) -> None:
    image, holds, empty = warped(ground(), level, degrees)
    found = sure(area_of(as_jpeg(image) if jpeg else image)).pixels(HEIGHT, WIDTH)
    assert (found & empty).sum() < 0.01 * empty.sum()
    assert (holds & ~found).mean() < 0.02


def test_a_lens_that_was_straightened_leaves_bent_wedges() -> None:
    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(np.float32)
    u, v = x / WIDTH - 0.5, y / WIDTH - HEIGHT / WIDTH / 2
    by = 1.06 - 0.25 * (u**2 + v**2) + 0.04
    image = cv2.remap(
        ground(), (u * by + 0.5) * WIDTH, v * by * WIDTH + HEIGHT / 2, cv2.INTER_CUBIC, borderValue=(0, 0, 0)
    )
    empty = (np.asarray(image) == 0).all(axis=2)
    assert empty.mean() > 0.02
    assert not (sure(area_of(np.asarray(image))).pixels(HEIGHT, WIDTH) & empty).any()


def test_zero_counts_around_a_frame_of_16_bits_are_a_wedge() -> None:
    image, holds, empty = warped(ground()[..., :1].repeat(3, axis=2), 0, 10)
    counts = np.where(holds, image[..., 0].astype(np.uint16) + 7000, 0)[..., None].astype(np.uint16)
    assert not (sure(area_of(counts)).pixels(HEIGHT, WIDTH) & empty).any()


def night() -> Bands:
    return np.asarray(np.clip(ground(1).astype(np.int16) - 130, 0, 255), np.uint8)


def lamp() -> Bands:
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    light = 255 * np.exp(-((x - WIDTH / 2) ** 2 + (y - HEIGHT / 2) ** 2) / 2 / 90**2) - 10
    return np.asarray(np.clip(light[..., None].repeat(3, axis=2), 0, 255), np.uint8)


def black_water() -> Bands:
    """Beyond a straight quay."""
    image = ground()
    cv2.fillPoly(image, [np.array([[0, 0], [WIDTH, 0], [WIDTH, 150], [0, 260]])], (0, 0, 0))
    return image


def burnt_roof() -> Bands:
    image = ground()
    cv2.fillPoly(image, [np.array([[0, 0], [150, 0], [0, 120]])], (255, 255, 255))
    return image


def vehicle_on_black() -> Bands:
    image, *_ = warped(ground(), 0, 40)
    image[4:9, 4:14] = 90
    return image


@pytest.mark.parametrize("scene", [ground, night, lamp, black_water, burnt_roof, vehicle_on_black])
def test_ground_is_no_wedge(scene: object) -> None:
    assert callable(scene)
    image = scene()
    assert area_of(image) is None
    assert area_of(as_jpeg(image)) is None


def test_what_a_file_tells_is_believed_whatever_its_shape_but_for_specks() -> None:
    told = np.ones((HEIGHT, WIDTH), bool)
    cv2.circle(hole := np.zeros((HEIGHT, WIDTH), np.uint8), (300, 200), 60, 1, -1)
    told[hole > 0] = False
    told[10, 10] = False
    found = sure(area_of(ground(), told)).pixels(HEIGHT, WIDTH)
    assert not found[hole > 0].any()
    assert found[10, 10]


def test_an_alpha_of_nothing_but_transparency_means_nothing() -> None:
    assert area_of(ground(), np.zeros((HEIGHT, WIDTH), bool)) is None
