import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from gcs_mosaic.render.blend_modes import MODES
from gcs_mosaic.render.blending import mix
from gcs_mosaic.render.cells import NOBODY, PARTLY, WHOLLY, Owned, Seen, lay_over, unknown
from gcs_mosaic.render.sampling import CUT
from gcs_mosaic.render.seams import LOOK
from gcs_mosaic.render.tile_cache import Layer, make_layer
from gcs_mosaic.render.warp_grid import LATTICE
from tests.sure import sure

shares = arrays(np.float32, (LATTICE, LATTICE), elements=st.floats(0, 1, width=32))
SHAPE = 8, 8
PLANES = {"seam": LOOK.stop, "edge": 1, "newest": 0, "first": 0}


def plain(value: int, weight: float) -> Layer:
    colour = np.full((256, 256, 3), value, np.uint8)
    return sure(make_layer(colour, None, np.full((LATTICE, LATTICE), weight, np.float32)))


def frame(mode: str, log_weight: float, covered: int = WHOLLY) -> Seen:
    """Of a frame in which nothing is to be seen."""
    score = np.full(SHAPE, log_weight - CUT * (covered == PARTLY), np.float32)
    return Seen(np.full(SHAPE, covered, np.uint8), score, np.zeros((PLANES[mode], *SHAPE), np.uint8))


def owned(mode: str, *frames: Seen) -> Owned:
    chosen = MODES[mode]
    cells = unknown(SHAPE, chosen.planes)
    for number, new in enumerate(frames):
        cells, _ = lay_over(cells, new, number, chosen.decide(cells, new))
    return chosen.own(cells)


@pytest.mark.parametrize("mode", MODES)
def test_where_only_one_covers_it_is_shown_alone(mode: str) -> None:
    for one, other, who in ((WHOLLY, 0, 0), (0, WHOLLY, 1)):
        found = owned(mode, frame(mode, -1, one), frame(mode, -1, other))
        assert (found.first == who).all()
        assert (found.share == 255).all()
        assert (found.second == NOBODY).all()


@pytest.mark.parametrize("mode", MODES)
def test_a_frame_that_covers_a_cell_comes_before_one_that_covers_a_part(mode: str) -> None:
    for one, other, who in ((WHOLLY, PARTLY, 0), (PARTLY, WHOLLY, 1)):
        found = owned(mode, frame(mode, -1 - one, one), frame(mode, -1 - other, other))
        assert (found.first == who).all()
        assert (found.share == 255).all()


@pytest.mark.parametrize("mode", MODES)
def test_where_two_cover_parts_neither_is_forgotten(mode: str) -> None:
    found = owned(mode, frame(mode, -1, PARTLY), frame(mode, -1.1, PARTLY))
    assert ((found.first + found.second) == 1).all()
    assert (found.share == 255).all()


@given(shares, st.integers(0, 255), st.integers(0, 255))
def test_a_mixture_lies_between_its_parts(share: NDArray[np.float32], a: int, b: int) -> None:
    colour = mix(plain(a, 0.5), plain(b, 0.5), share).colour
    assert min(a, b) <= colour.min() <= colour.max() <= max(a, b)


@pytest.mark.parametrize(("mode", "who"), [("newest", 2), ("first", 0)])
def test_the_simple_modes(mode: str, who: int) -> None:
    assert (owned(mode, *[frame(mode, 0)] * 3).first == who).all()
