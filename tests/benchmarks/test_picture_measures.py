"""The measures of the picture tell what they are meant to tell: each is given pictures of which the answer is known."""

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from tests.benchmarks.picture_measures import (
    contrast,
    contrast_kept,
    detail,
    seam_steps,
    shown_share,
    transparent_share,
)

pytestmark = pytest.mark.long


Picture = NDArray[np.float32]

SIDE = 128
ALL = np.ones((SIDE, SIDE), bool)


@pytest.fixture(scope="module")
def ground() -> Picture:
    rough = np.random.default_rng(1).normal(120, 30, (SIDE, SIDE, 3)).astype(np.float32)
    return np.clip(cv2.GaussianBlur(rough, (0, 0), 0.8), 20, 230)


def weights(left: float, right: float) -> Picture:
    return np.repeat(np.where(np.arange(SIDE) < SIDE // 2, left, right)[None], SIDE, axis=0).astype(np.float32)


def noisy(picture: Picture, seed: int, sigma: float = 1.5) -> Picture:
    return picture + np.random.default_rng(seed).normal(0, sigma, picture.shape).astype(np.float32)


def test_a_frame_alone_keeps_all_its_detail_at_any_brightness(ground: Picture) -> None:
    found = detail(0.5 * ground, [ground, ground], [ALL, ALL], [weights(1, 1), weights(0, 0)])
    assert found.kept == pytest.approx(1, abs=0.01)


def test_two_frames_that_do_not_fit_lose_detail_when_they_are_averaged(ground: Picture) -> None:
    off = np.roll(ground, 3, axis=1)
    assert detail((ground + off) / 2, [ground, off], [ALL, ALL], [weights(1, 1), weights(0, 0)]).kept < 0.65


def test_detail_is_that_of_the_frame_that_sees_the_place_best(ground: Picture) -> None:
    soft = cv2.GaussianBlur(ground, (0, 0), 2)
    on_left, on_right = (detail(soft, [ground, soft], [ALL, ALL], [weights(*one), weights(0.5, 0.5)]).of_central.sum()
                         for one in ((1, 1), (0, 0)))  # fmt: skip
    assert on_left > 5 * on_right


def test_the_sharpest_frame_is_found_whatever_its_weight(ground: Picture) -> None:
    soft = np.asarray(cv2.GaussianBlur(ground, (0, 0), 2), np.float32)
    found = detail(soft, [soft, ground], [ALL, ALL], [weights(1, 1), weights(0, 0)])
    assert found.kept == pytest.approx(1)
    assert found.kept_of_sharpest < 0.2


def test_only_overlaps_count(ground: Picture) -> None:
    left = np.arange(SIDE)[None].repeat(SIDE, axis=0) < SIDE // 2
    alone = detail(ground, [ground, ground], [ALL, left], [weights(1, 1), weights(1, 1)])
    assert len(alone.of_map) == (SIDE // 32) * (SIDE // 64)


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("step", [0.0, 6.0, -6.0])
def test_a_seam_has_the_step_between_its_frames_and_the_ground_has_none(
    ground: Picture, step: float, turned: bool
) -> None:
    slope = np.linspace(0, 60, SIDE, dtype=np.float32)[None, :, None]
    a, b = noisy(ground + slope, 1), noisy(ground + slope + step, 2)
    if turned:
        a, b = a.swapaxes(0, 1), b.swapaxes(0, 1)
    at = np.arange(SIDE) < SIDE // 2
    mosaic = np.where(at[:, None, None] if turned else at[None, :, None], a, b)
    steps = seam_steps(mosaic, [a, b], [ALL, ALL])
    assert len(steps) > SIDE // 2
    assert steps.mean() == pytest.approx(abs(step), abs=0.7)


def test_a_soft_transition_hardly_steps(ground: Picture) -> None:
    a, b = noisy(ground, 1), noisy(ground + 10, 2)
    share = np.linspace(0, 1, SIDE, dtype=np.float32)[None, :, None]
    steps = seam_steps(a + share * (b - a), [a, b], [ALL, ALL])
    assert steps.mean() < 2.5


def test_one_frame_alone_has_no_seam(ground: Picture) -> None:
    assert len(seam_steps(ground, [ground], [ALL])) == 0
    assert len(seam_steps(ground, [ground, noisy(ground, 3, 5.0)], [ALL, ALL])) == 0


def person(ground: Picture) -> Picture:
    with_one = ground.copy()
    with_one[60:66, 60:67] = (40, 110, 235)
    return with_one


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_the_share_of_a_person_is_told_whatever_the_brightness(ground: Picture, share: float) -> None:
    frame = person(ground)
    mosaic = noisy(ground + share * (frame - ground) + 9, 1)
    assert shown_share(mosaic, frame, ground) == pytest.approx(share, abs=0.05)
    assert transparent_share(mosaic, frame, ground) == pytest.approx(float(share == 0.3), abs=0.05)


def test_a_person_cut_in_two_is_half_there_and_not_transparent(ground: Picture) -> None:
    frame = person(ground)
    mosaic = frame.copy()
    mosaic[:, 63:] = ground[:, 63:]
    assert shown_share(mosaic, frame, ground) == pytest.approx(3 / 7, abs=0.1)
    assert transparent_share(mosaic, frame, ground) == 0


@pytest.mark.parametrize("gain", [0.5, 1.0, 1.7])
def test_contrast_is_the_same_at_every_gain_and_less_when_it_is_washed_out(gain: float) -> None:
    flat = np.full((41, 41, 3), 90.0)
    mark = flat.copy()
    mark[18:24, 18:24] = (40, 110, 135)
    one = contrast(mark, (20.5, 20.5), 2)
    assert contrast_kept(contrast(gain * mark, (20.5, 20.5), 2), one) == pytest.approx(1)
    assert contrast_kept(contrast((mark + flat) / 2, (20.5, 20.5), 2), one) == pytest.approx(0.5)
