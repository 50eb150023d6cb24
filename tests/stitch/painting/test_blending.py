import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from gcs_mosaic.stitch.painting.blending import Part, mix
from gcs_mosaic.stitch.painting.lattice import LATTICE
from gcs_mosaic.stitch.painting.layers import Layer, make_layer
from gcs_mosaic.stitch.painting.modes import BLENDS

shares = arrays(np.float32, (LATTICE, LATTICE), elements=st.floats(0, 1, width=32))


def plain(value: int, weight: float, covered: slice = slice(None)) -> Layer:
    coverage = np.zeros((256, 256), np.uint8)
    coverage[:, covered] = 255
    colour = (coverage[..., None] // 255 * value).repeat(3, axis=2).astype(np.uint8)
    return make_layer(colour, coverage, np.full((LATTICE, LATTICE), weight, np.float32))


def part(layer: Layer, mode: str = "first") -> Part:
    """A layer as a new frame of which nothing is measured but what its mode finds on a picture without detail."""
    measured = BLENDS[mode].measure(np.full((64, 64, 3), layer.colour.max(), np.uint8))
    return Part(layer.weight, measured[:1, :1].repeat(2 * LATTICE - 1, 0).repeat(2 * LATTICE - 1, 1), lambda: layer)


@pytest.mark.parametrize("mode", BLENDS)
def test_where_only_one_covers_it_is_shown_alone(mode: str) -> None:
    shown = BLENDS[mode].over(plain(100, 0.9, slice(0, 200)), part(plain(30, 0.1, slice(100, 256)), mode))
    assert (shown.colour[:, :100] == 100).all()
    assert (shown.colour[:, 200:] == 30).all()
    assert shown.is_full


@given(shares, st.integers(0, 255), st.integers(0, 255))
def test_a_mixture_lies_between_its_parts(share, a: int, b: int) -> None:
    colour = mix(plain(a, 0.5), plain(b, 0.5), share).colour
    assert min(a, b) <= colour.min() <= colour.max() <= max(a, b)


@pytest.mark.parametrize(("mode", "value"), [("newest", 30), ("first", 100)])
def test_the_simple_modes(mode: str, value: int) -> None:
    assert (BLENDS[mode].over(plain(100, 0.9), part(plain(30, 0.1))).colour == value).all()
