"""The picture that grows, and the tiles cut from it."""

import numpy as np
import pytest

from gcs_mosaic.baseline.raster import Raster, RasterBox
from gcs_mosaic.render.pyramid import TilePicture
from gcs_mosaic.render.render_list import Extent
from gcs_mosaic.render.tile_grid import Tile, tile_box


@pytest.fixture
def raster() -> Raster:
    """Half-size frames; a gradient over (-100, -30) to (700, 300)."""
    raster = Raster(reduction=2)
    painted = RasterBox(-100, -30, 700, 300)
    colour, coverage = raster.part(painted)
    colour[:] = np.linspace(0, 200, 800, dtype=np.uint8)[None, :, None]
    coverage[:] = 255
    raster.put(painted, colour, coverage)
    return raster


def picture_of(raster: Raster, tile: Tile) -> TilePicture:
    shown = raster.tile(tile)
    assert shown is not None
    return shown


def extent_of(raster: Raster) -> Extent:
    extent = raster.extent()
    assert extent is not None
    return extent


def test_growing_keeps_what_is_there(raster: Raster) -> None:
    before = raster.part(RasterBox(-100, -30, 700, 300))[0]
    beside = RasterBox(-3000, 400, 900, 2000)
    raster.put(beside, *raster.part(beside))
    assert raster.window == RasterBox(-3072, -256, 1024, 2048)
    assert (raster.part(RasterBox(-100, -30, 700, 300))[0] == before).all()
    assert raster.part(raster.window)[1].sum() == 255 * 800 * 330


def test_tiles_lie_where_the_canvas_says(raster: Raster) -> None:
    """A pixel of a half-size picture covers two canvas units, from half a unit before the canvas' zero."""
    (tile,) = (t for t in raster.tiles(RasterBox(0, 0, 10, 10)) if t.z == 15)
    assert tile_box(tile)[:2] == (-0.5, -0.5)
    shown = picture_of(raster, tile)
    assert (shown.colour[:200] == raster.part(RasterBox(0, 0, 256, 200))[0]).all()
    assert (shown.coverage == 255).all()


def test_coarser_tiles_are_means_of_what_is_covered(raster: Raster) -> None:
    tile = Tile(14, 2**13, 2**13)
    assert tile_box(tile)[:2] == (-0.5, -0.5)
    shown = picture_of(raster, tile)
    fine = raster.part(RasterBox(0, 0, 512, 256))[0].astype(float)
    assert np.allclose(shown.colour[:128], fine.reshape(128, 2, 256, 2, 3).mean(axis=(1, 3)), atol=1)
    above = picture_of(raster, Tile(14, tile.x, tile.y - 1))
    assert set(np.unique(above.coverage)) == {0, 255}
    assert (above.coverage[-15:] == 255).all()
    assert (above.coverage[:-15] == 0).all()
    assert np.allclose(above.colour[-1].astype(int), shown.colour[0], atol=1)


def test_all_tiles_that_show_anything_are_told_of(raster: Raster) -> None:
    told = raster.tiles(RasterBox(-100, -30, 700, 300))
    extent = extent_of(raster)
    assert {tile.z for tile in told} == set(range(extent.coarsest, extent.finest + 1))
    assert all(raster.tile(tile) is not None for tile in told if tile.z < 15)
    assert raster.tile(Tile(15, 0, 0)) is None


def test_a_mosaic_that_grows_beyond_a_level_tells_of_the_new_one_as_a_whole(raster: Raster) -> None:
    coarsest = extent_of(raster).coarsest
    raster.tiles(RasterBox(-100, -30, 700, 300))
    far = RasterBox(5000, 0, 5010, 10)
    raster.put(far, *raster.part(far))
    told = raster.tiles(far)
    assert extent_of(raster).coarsest < coarsest
    first = {tile for tile in told if tile.z == coarsest - 1}
    assert any(tile_box(tile)[0] <= -200 for tile in first)  # the beginning, which has not changed


def test_an_empty_raster_has_no_extent() -> None:
    assert Raster(1).extent() is None
    assert Raster(1).level == 16
