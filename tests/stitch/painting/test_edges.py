import cv2
import numpy as np
import pytest

from gcs_mosaic.stitch.painting.blending import Part
from gcs_mosaic.stitch.painting.edges import edge, edge_density
from gcs_mosaic.stitch.painting.lattice import LATTICE
from gcs_mosaic.stitch.painting.layers import Layer, make_layer

FINE = 2 * LATTICE - 1


def plain(value: int, weight: float) -> Layer:
    return make_layer(np.full((256, 256, 3), value, np.uint8), None, np.full((LATTICE, LATTICE), weight, np.float32))


def part(value: int, weight: float, density: float = 0.0) -> Part:
    layer = plain(value, weight)
    return Part(layer.weight, np.full((FINE, FINE, 1), density, np.float32), lambda: layer)


def test_on_smooth_ground_the_heavier_frame_shows_more() -> None:
    values = [edge(plain(100, 0.5), part(0, w)).colour[0, 0, 0] for w in (0.3, 0.5, 0.7)]
    assert 80 < values[0] < 100
    assert values[1] == 50
    assert 0 < values[2] < 25


def test_where_edges_are_dense_one_frame_shows_alone() -> None:
    values = [edge(plain(100, 0.5), part(0, w, 1.0)).colour[0, 0, 0] for w in (0.3, 0.5, 0.7)]
    assert values == [100, 0, 0]


def test_a_new_frame_without_weight_is_not_even_looked_at() -> None:
    def never() -> Layer:
        raise AssertionError("looked at")

    shown = plain(100, 0.9)
    after = edge(shown, Part(shown.weight * 0, np.zeros((FINE, FINE, 1), np.float32), never))
    assert after.colour is shown.colour


def test_the_greatest_weight_is_remembered() -> None:
    assert (edge(plain(100, 0.2), part(0, 0.7)).weight == np.float32(0.7)).all()


@pytest.mark.parametrize("contrast", [0.3, 1.0])
def test_edges_are_found_where_they_are_dense_in_dim_light_too(contrast: float) -> None:
    rng = np.random.default_rng(1)
    ground = np.full((600, 800, 3), 100, np.float32) + rng.normal(0, 2, (600, 800, 3))
    ground[:, 500:] += cv2.GaussianBlur(rng.normal(0, 600, (600, 300, 3)), (0, 0), 2)
    density = edge_density(np.clip(ground * contrast, 0, 255).astype(np.uint8))
    assert density.shape == (150, 200, 1)
    assert density[20:-20, 150:180].mean() > 0.8
    assert density[20:-20, 20:100].mean() < 0.1
