from collections.abc import Sequence

import cv2
import numpy as np
import pytest

from gcs_mosaic.render.saliency import MISPLACED, REACH, TALL, WAYS, saliency


def ground(noise: float = 3.0, seed: int = 1) -> np.ndarray:
    rng = np.random.default_rng(seed)
    rough = cv2.GaussianBlur(rng.normal(0, 1, (400, 600, 3)).astype(np.float32), (0, 0), 1.5)
    return np.asarray(np.clip(100 + noise * rough / rough.std(), 0, 255), np.uint8)


def in_lab(step: Sequence[int]) -> np.ndarray:
    """A colour that differs from the ground by so much in L, a and b."""
    ground_lab = cv2.cvtColor(np.full((1, 1, 3), 100, np.uint8), cv2.COLOR_BGR2Lab)[0, 0].astype(int)
    return np.asarray(cv2.cvtColor((ground_lab + step).astype(np.uint8)[None, None], cv2.COLOR_Lab2BGR)[0, 0])


@pytest.mark.parametrize("side", [4, 6, 15])
@pytest.mark.parametrize("way", range(WAYS))
def test_a_small_thing_stands_out_by_any_of_its_colours(side: int, way: int) -> None:
    picture = ground()
    step = [0, 0, 0]
    step[way % 3] = 45 if way < 3 else -45
    picture[200 : 200 + side, 300 : 300 + side] = in_lab(step)
    things, near, far = saliency(picture)
    assert things.shape == near.shape == far.shape == (WAYS, 100, 150)
    reach = REACH // 4
    assert (things[way, 50 - reach + 1 : 50 + reach, 75] > 25).all()
    assert things[:, :20].max() == things[..., :40].max() == 0
    assert (near >= things).all()
    assert (far >= near).all()


def test_the_coloured_fringes_that_a_lens_gives_to_edges_are_no_things() -> None:
    """Red is drawn a pixel farther out than green and blue: two pixels of a frame of 12 MP."""
    picture = ground()
    picture[150:250, 200:260] = 230
    red = np.roll(picture[..., 2], 1, axis=1)
    things = saliency(np.dstack([picture[..., :2], red]))[0]
    assert things[[0, 3]].max() > 30
    assert things[[1, 2, 4, 5]].max() == 0


@pytest.mark.parametrize("clothes", [(40, 60, 200), (200, 90, 30), (60, 200, 220)])
def test_somebody_in_bright_clothes_stands_out_by_colour_on_sand(clothes: tuple[int, int, int]) -> None:
    sand = ground() + np.array([50, 80, 90], np.uint8)
    sand[200:208, 300:308] = clothes
    assert saliency(sand)[0][[1, 2, 4, 5], 50, 75].max() > 20


@pytest.mark.parametrize("noise", [1.0, 10.0, 40.0])
def test_ground_that_is_rough_all_over_does_not_stand_out(noise: float) -> None:
    assert (saliency(ground(noise))[0].max(axis=0) > 0).mean() < 0.1


@pytest.mark.parametrize(("reach", "which"), [(MISPLACED, 1), (TALL, 2)])
def test_a_thing_that_lies_beside_is_within_the_contrast_of_the_other_frame(reach: int, which: int) -> None:
    frames = [ground(), ground()]
    for frame, x in zip(frames, (300, 300 + reach - 4), strict=True):
        frame[200:210, x : x + 10] = 220
    one, other = (saliency(frame) for frame in frames)
    assert (one[0] <= 1.05 * other[which]).all()
    assert (other[0] <= 1.05 * one[which]).all()
