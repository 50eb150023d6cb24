"""The paper's blend: each picture heavier the farther from its border, the new one where edges are dense."""

import numpy as np
import pytest

from gcs_mosaic.baseline.blending import BOOST, blend, border_distance, edge_boost
from gcs_mosaic.stitch.arrays import ImageBGR


def flat(value: int, shape: tuple[int, int] = (60, 80)) -> ImageBGR:
    return np.full((*shape, 3), value, np.uint8)


def test_weights_grow_from_the_border() -> None:
    distance = border_distance(np.full((60, 80), 255, np.uint8))
    assert distance[0, 40] == pytest.approx(1, abs=0.05)
    assert distance[30, 40] == pytest.approx(30, abs=1)


def test_where_only_one_covers_it_stands_alone() -> None:
    coverage = np.zeros((60, 80), np.uint8)
    coverage[:, 40:] = 255
    mixed = blend(flat(50), border_distance(255 - coverage), flat(200), coverage)
    assert (mixed[:, :40] == 50).all()
    assert (mixed[:, 40:] == 200).all()


def test_the_nearer_to_its_own_middle_the_more_of_it_shows() -> None:
    everywhere = np.full((60, 80), 255, np.uint8)
    left = everywhere.copy()
    left[:, 60:] = 0
    mixed = blend(flat(50), border_distance(left), flat(200), everywhere)[30, :, 0].astype(int)
    assert mixed[25] == pytest.approx(125, abs=15)  # as far from either border
    assert (np.diff(mixed[35:60]) >= 0).all()
    assert mixed[59] > 180


def test_dense_edges_make_the_new_frame_heavier() -> None:
    rough = flat(200)
    rough[20:40, 20:60] = np.where(np.arange(40) % 8 < 4, 0, 200)[None, :, None]
    assert (edge_boost(rough)[22:38, 24:56] == BOOST).all()
    assert edge_boost(rough)[5, 5] == 1
    everywhere = np.full((60, 80), 255, np.uint8)
    weight = border_distance(everywhere)
    mixed = blend(flat(50), weight, rough, everywhere)
    assert mixed[5, 5, 0] == 125
    assert mixed[30, 49, 0] == pytest.approx((BOOST * 200 + 50) / (BOOST + 1), abs=1)
