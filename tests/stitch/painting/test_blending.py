import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from gcs_mosaic.stitch.painting.blending import BLENDS, NewPart, edge_density, mix
from gcs_mosaic.stitch.painting.lattice import LATTICE
from gcs_mosaic.stitch.painting.layers import Layer, make_layer

shares = arrays(np.float32, (LATTICE, LATTICE), elements=st.floats(0, 1, width=32))


def plain(value: int, weight: float, covered: slice = slice(None)) -> Layer:
    coverage = np.zeros((256, 256), np.uint8)
    coverage[:, covered] = 255
    colour = (coverage[..., None] // 255 * value).repeat(3, axis=2).astype(np.uint8)
    return make_layer(colour, coverage, np.full((LATTICE, LATTICE), weight, np.float32))


def part(layer: Layer, density: float = 0.0) -> NewPart:
    return NewPart(layer.weight, np.full((LATTICE, LATTICE), density, np.float32), lambda: layer)


@pytest.mark.parametrize("mode", BLENDS)
def test_where_only_one_covers_it_is_shown_alone(mode: str) -> None:
    shown = BLENDS[mode](plain(100, 0.9, slice(0, 200)), part(plain(30, 0.1, slice(100, 256))))
    assert (shown.colour[:, :100] == 100).all()
    assert (shown.colour[:, 200:] == 30).all()
    assert shown.is_full


@given(shares, st.integers(0, 255), st.integers(0, 255))
def test_a_mixture_lies_between_its_parts(share, a: int, b: int) -> None:
    colour = mix(plain(a, 0.5), plain(b, 0.5), share).colour
    assert min(a, b) <= colour.min() <= colour.max() <= max(a, b)


@pytest.mark.parametrize(("mode", "value"), [("newest", 30), ("first", 100)])
def test_the_simple_modes(mode: str, value: int) -> None:
    assert (BLENDS[mode](plain(100, 0.9), part(plain(30, 0.1))).colour == value).all()


def test_on_smooth_ground_the_heavier_frame_shows_more() -> None:
    values = [BLENDS["edge"](plain(100, 0.5), part(plain(0, w))).colour[0, 0, 0] for w in (0.3, 0.5, 0.7)]
    assert 80 < values[0] < 100
    assert values[1] == 50
    assert 0 < values[2] < 25


def test_where_edges_are_dense_one_frame_shows_alone() -> None:
    values = [BLENDS["edge"](plain(100, 0.5), part(plain(0, w), 1.0)).colour[0, 0, 0] for w in (0.3, 0.5, 0.7)]
    assert values == [100, 0, 0]


def test_a_new_frame_without_weight_is_not_even_looked_at() -> None:
    def never() -> Layer:
        raise AssertionError("looked at")

    shown = plain(100, 0.9)
    after = BLENDS["edge"](shown, NewPart(np.zeros((LATTICE, LATTICE), np.float32), shown.weight * 0, never))
    assert after.colour is shown.colour


def test_the_greatest_weight_is_remembered() -> None:
    assert (BLENDS["edge"](plain(100, 0.2), part(plain(0, 0.7))).weight == np.float32(0.7)).all()


@pytest.mark.parametrize("contrast", [0.3, 1.0])
def test_edges_are_found_where_they_are_dense_in_dim_light_too(contrast: float) -> None:
    rng = np.random.default_rng(1)
    ground = np.full((600, 800, 3), 100, np.float32) + rng.normal(0, 2, (600, 800, 3))
    ground[:, 500:] += cv2.GaussianBlur(rng.normal(0, 600, (600, 300, 3)), (0, 0), 2)
    density = edge_density(np.clip(ground * contrast, 0, 255).astype(np.uint8))
    assert density.shape == (150, 200)
    assert density[20:-20, 150:180].mean() > 0.8
    assert density[20:-20, 20:100].mean() < 0.1
