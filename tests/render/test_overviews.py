import numpy as np

from gcs_mosaic.render.overviews import FEATHER, assemble, composite, shrink
from gcs_mosaic.render.tile_cache import Layer, make_layer
from gcs_mosaic.render.warp_grid import LATTICE
from tests.sure import sure


def plain(value: int, side: int = 256, weight: float = 1.0, covered: slice = slice(None)) -> Layer:
    coverage = np.zeros((side, side), np.uint8)
    coverage[:, covered] = 255
    colour = np.where(coverage[..., None] > 0, np.uint8(value), np.uint8(0)).repeat(3, axis=2)
    return sure(make_layer(colour, coverage, np.full((side // 16 + 1, side // 16 + 1), weight, np.float32)))


def test_shrinking_takes_the_mean_of_what_is_covered_only() -> None:
    half = sure(shrink(plain(100, covered=slice(0, 101))))
    assert half.side == 128
    assert (half.colour[:, :51] == 100).all()
    assert half.coverage[0, 49:52].tolist() == [255, 128, 0]


def test_shrinking_a_full_layer_takes_the_mean_of_four() -> None:
    colour = np.arange(256, dtype=np.uint8)[:, None, None].repeat(256, 1).repeat(3, 2)
    layer = sure(make_layer(colour, None, plain(0).weight))
    np.testing.assert_allclose(sure(shrink(layer)).colour[:, 0, 0], np.arange(128) * 2 + 0.5, atol=0.5)


def test_a_tile_is_put_together_from_its_quarters() -> None:
    tile = sure(assemble([plain(10, 128), None, plain(30, 128), plain(40, 128, weight=0.5)]))
    assert tile.colour[[0, 0, 255, 255], [0, 255, 0, 255], 0].tolist() == [10, 0, 30, 40]
    assert tile.coverage[0, 255] == 0
    assert tile.weight.shape == (LATTICE, LATTICE)
    assert assemble([None] * 4) is None


def test_the_finer_picture_lies_on_top_and_fades_in_from_its_border() -> None:
    finer = plain(200, covered=slice(0, 128))
    ramp = np.clip(np.linspace(2 * FEATHER, -2 * FEATHER, LATTICE), 0, 1).astype(np.float32)
    finer = sure(make_layer(finer.colour, finer.coverage, np.tile(ramp, (LATTICE, 1))))
    shown = sure(composite(plain(100), finer))
    row = shown.colour[7, :, 0].astype(int)
    assert (row[0], row[200]) == (200, 100)
    assert (np.diff(row) <= 0).all()
    assert abs(np.diff(row)).max() <= 4
    assert shown.is_full


def test_one_picture_alone_is_shown_as_it_is() -> None:
    only = plain(50)
    assert composite(only, None) is only
    assert composite(None, only) is only
    assert composite(None, None) is None
