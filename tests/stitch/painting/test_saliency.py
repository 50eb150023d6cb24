import cv2
import numpy as np
import pytest

from gcs_mosaic.stitch.painting.saliency import REACH, saliency


def ground(noise: float = 3.0, seed: int = 1) -> np.ndarray:
    rng = np.random.default_rng(seed)
    rough = cv2.GaussianBlur(rng.normal(0, 1, (400, 600, 3)).astype(np.float32), (0, 0), 1.5)
    return np.clip(100 + noise * rough / rough.std(), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("side", [3, 6, 15])
@pytest.mark.parametrize("step", [(40, 40, 40), (-40, -40, -40), (0, 0, 45)])
def test_a_small_thing_stands_out_by_any_of_its_colours(side: int, step: tuple[int, int, int]) -> None:
    picture = ground()
    picture[200 : 200 + side, 300 : 300 + side] = np.clip(100 + np.array(step), 0, 255)
    strong, weak = saliency(picture)
    assert strong.shape == weak.shape == (100, 150)
    reach = REACH // 4
    assert (strong[50 - reach + 1 : 50 + reach, 75] == 1).all()
    assert strong[:20].max() == strong[:, :40].max() == 0
    assert (weak >= strong).all()


@pytest.mark.parametrize("noise", [1.0, 10.0, 40.0])
def test_ground_that_is_rough_all_over_does_not_stand_out(noise: float) -> None:
    assert saliency(ground(noise))[0].mean() < 0.01


def test_a_thing_that_hardly_stands_out_may_be_one() -> None:
    picture = ground(noise=2.0)
    picture[200:210, 300:310] = 112
    strong, weak = saliency(picture)
    assert strong[50, 75] == 0
    assert weak[50, 75] == 1
