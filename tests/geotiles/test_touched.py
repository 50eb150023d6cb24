"""Geo tiles that are made anew after something was painted are those that look different, and few others."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gcs_mosaic.geotiles.canvas_tiles import canvas_tile, tiles_at_rest
from gcs_mosaic.geotiles.earth_islands import EarthIsland
from gcs_mosaic.geotiles.pyramid import GeoPyramid
from gcs_mosaic.geotiles.touched import touched
from gcs_mosaic.render.pyramid import TilePicture
from gcs_mosaic.render.tile_grid import Tile, ancestor, tile_box, tiles_over
from gcs_mosaic.stitch.arrays import AnyImage
from gcs_mosaic.store.tiles import read_tile, remove_tile, write_tile
from tests.geotiles.ground import anchor, island
from tests.sure import sure
from tests.tiers import thorough

BOX = (-1100.0, -800.0, 1100.0, 800.0)
HOLE = Tile(16, (1 << 15) + 0, (1 << 15) + 0)
AT_BORDERS = [Tile(16, (1 << 15) - 2, 1 << 15), Tile(15, 1 << 14, (1 << 14) - 1)]


def plain(value: int) -> TilePicture:
    return TilePicture(np.full((256, 256, 3), value, np.uint8), np.full((256, 256), 255, np.uint8))


@pytest.fixture
def laid() -> EarthIsland:
    return island(BOX, laid=anchor(turned_deg=25.0))


@pytest.fixture
def flight(tmp_path: Path, laid: EarthIsland) -> Path:
    """Grey ground at all levels, but for a hole at the finest that a coarser tile fills."""
    for level in range(laid.coarsest, 17):
        for tile in tiles_over(BOX, level):
            if tile != HOLE:
                write_tile(tmp_path, 0, tile, plain(100), 95)
    return tmp_path


def paint(flight: Path, laid: EarthIsland, tile: Tile, value: int) -> None:
    """A tile, and its part of those above it."""
    for level in range(laid.coarsest, tile.z + 1):
        above = ancestor(tile, level)
        side = 256 >> (tile.z - level)
        left, top = ((at * side) % 256 for at in tile[1:])
        picture = sure(read_tile(flight, 0, above)) if above != tile else plain(value)
        colour = picture.colour.copy()
        colour[top : top + side, left : left + side] = value
        write_tile(flight, 0, above, TilePicture(colour, picture.coverage), 95)


def differing(flight: Path, laid: EarthIsland, tile: Tile) -> dict[int, set[tuple[int, int]]]:
    """The geo tiles of each level that look different after a tile was painted."""

    def shown() -> dict[tuple[int, int, int], AnyImage | None]:
        pyramid = GeoPyramid((laid,), tiles_at_rest(flight))
        levels = *range(laid.levels[0] + 2, laid.levels[1], 3), laid.levels[1], laid.levels[1] + 1
        return {(level, x, y): pyramid.tile(level, x, y) for level in levels for x, y in pyramid.tiles(level)}

    before = shown()
    paint(flight, laid, tile, 200)
    changed: dict[int, set[tuple[int, int]]] = {level: set() for level, _, _ in before}
    for (level, x, y), now in shown().items():
        then = before[level, x, y]
        # A JPEG of a coarse tile rings by a grey level or two in the blocks beside what has changed.
        if now is not None and (then is None or np.abs(now.astype(int) - then).max() > 3):
            changed[level].add((x, y))
    return changed


@pytest.mark.long
@pytest.mark.parametrize(
    "tile", [HOLE, thorough(Tile(16, (1 << 15) - 2, 1 << 15)), thorough(Tile(15, 1 << 14, (1 << 14) - 1))], ids=str
)
def test_none_that_looks_different_is_missed_and_few_are_made_in_vain(
    flight: Path, laid: EarthIsland, tile: Tile
) -> None:
    different = differing(flight, laid, tile)
    pyramid = GeoPyramid((laid,), tiles_at_rest(flight))
    told = 0
    for level, places in different.items():
        every = np.array(list(pyramid.tiles(level)))
        found = {(int(x), int(y)) for x, y in every[touched(laid, [tile], level, every)]}
        assert places <= found, level
        told += len(found)
    assert sum(map(len, different.values())) > 0
    if tile.z == 16:  # what is finer than a coarse tile hides it, which nobody knows beforehand
        assert told <= 7 * sum(map(len, different.values()))
    finest = np.array(list(pyramid.tiles(laid.levels[1] + 1)))
    assert not touched(laid, [tile], laid.levels[1] + 1, finest).all()


def test_far_away_nothing_is_touched(laid: EarthIsland) -> None:
    here = np.array(list(GeoPyramid((laid,), lambda _one, _tile: None).tiles(laid.levels[1])))
    assert not touched(laid, [Tile(16, (1 << 15) + 40, 1 << 15)], laid.levels[1], here).any()
    assert not touched(laid, [], laid.levels[1], here).any()
    assert touched(laid, [HOLE], laid.levels[1], here[:0]).shape == (0,)


def test_across_the_180th_meridian_both_sides_are_touched() -> None:
    laid = island(BOX, laid=anchor(longitude=180.0, latitude=-17.0))
    level = laid.levels[1] - 1
    places = np.array(list(GeoPyramid((laid,), lambda _one, _tile: None).tiles(level)))
    assert touched(laid, [HOLE], level, places).any()
    assert touched(laid, [Tile(12, 1 << 11, 1 << 11)], level, places).all()


def test_a_canvas_tile_is_as_the_page_shows_it_and_its_colours_count_as_far_as_it_covers(
    flight: Path, laid: EarthIsland
) -> None:
    filled = sure(canvas_tile(flight, laid, HOLE))
    assert (filled[..., 3].min(), int(filled[..., 0].mean())) == (255, 100)
    coverage = np.full((256, 256), 51, np.uint8)
    write_tile(flight, 0, HOLE, TilePicture(np.full((256, 256, 3), 100, np.uint8), coverage), 95)
    for level in range(laid.coarsest, 16):
        remove_tile(flight, 0, ancestor(HOLE, level))
    assert sure(canvas_tile(flight, laid, HOLE))[100, 100].tolist() == [20, 20, 20, 51]
    assert canvas_tile(flight, laid, Tile(16, 0, 0)) is None


def test_coarser_tiles_than_there_are_on_disk_are_made_of_finer_ones(flight: Path, laid: EarthIsland) -> None:
    for level in range(laid.coarsest - 1, laid.coarsest - 5, -1):
        seen = [canvas_tile(flight, laid, tile) for tile in tiles_over(BOX, level)]
        area = sum(float(one[..., 3].sum()) for one in seen if one is not None) / 255
        pixel = (tile_box(Tile(level, 0, 0))[2] - tile_box(Tile(level, 0, 0))[0]) / 256
        coarsest = list(tiles_over(BOX, laid.coarsest))
        whole = sum((tile_box(tile)[2] - tile_box(tile)[0]) ** 2 for tile in coarsest)
        assert area * pixel**2 == pytest.approx(whole, rel=0.05)
        visible = [one[one[..., 3] == 255][:, 0] for one in seen if one is not None]
        assert all(abs(int(value) - 100) <= 1 for values in visible for value in np.unique(values))
