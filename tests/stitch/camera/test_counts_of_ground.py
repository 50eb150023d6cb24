"""One band as grey levels, for features."""

import numpy as np
import pytest

from gcs_mosaic.stitch.camera.bands import stretched

GROUND = np.random.default_rng(1).normal(32_900, 60, (60, 80)).astype(np.uint16)


@pytest.mark.parametrize("columns", [0, 5, 40])
def test_a_border_without_data_leaves_the_ground_its_contrast(columns: int) -> None:
    band = GROUND.copy()
    band[:, :columns] = 0
    levels = stretched(band)
    assert not levels[:, :columns].any()
    assert levels[:, columns:].std() > 40


def test_eight_bits_may_be_black() -> None:
    dark = (np.arange(4800).reshape(60, 80) % 4).astype(np.uint8)
    assert stretched(dark)[0, :4].tolist() == [0, 85, 170, 255]


def test_a_band_of_zeros_alone_is_black() -> None:
    assert not stretched(np.zeros((6, 8), np.uint16)).any()
