"""Tiles of a map on earth: no borders between them, islands over each other, and around the 180th meridian."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gcs_mosaic.geo.mercator import HALF_WORLD_M, resolution_m
from gcs_mosaic.geotiles.earth_islands import canvas_islands, earth_islands
from gcs_mosaic.geotiles.picture_grid import PictureGrid, grid_of_tile
from gcs_mosaic.geotiles.pyramid import GeoPyramid
from tests.geotiles.ground import anchor, island, noisy, pyramid, waves
from tests.geotiles.test_earth_warp import tile_at
from tests.sure import sure

WIDE = (-4000.0, -4000.0, 4000.0, 4000.0)


@pytest.mark.long
@pytest.mark.parametrize(("down", "latitude"), [(-2, 44.5), (0, 68.0), (0, 0.0), (1, 44.5)])
def test_tiles_are_parts_of_one_picture(down: int, latitude: float) -> None:
    """As one picture of the whole, and no step at their borders beyond those inside."""
    laid = island(WIDE, laid=anchor(latitude=latitude))
    shown = GeoPyramid((laid,), noisy())
    level = laid.levels[1] - down
    x, y = tile_at(laid, level)
    tiles = [[shown.tile(level, x + i, y + j) for i in range(-1, 2)] for j in range(-1, 2)]
    parts = np.vstack([np.hstack([sure(one) for one in row]) for row in tiles]).astype(float)
    north_west, south_east = grid_of_tile(level, x - 1, y - 1).bounds, grid_of_tile(level, x + 1, y + 1).bounds
    bounds = north_west[0], south_east[1], south_east[2], north_west[3]
    whole = sure(shown.picture(PictureGrid("mercator", bounds, 768, 768))).astype(float)
    seen = (parts[..., 3] == 255) & (whole[..., 3] == 255)
    assert seen.mean() > 0.9
    assert np.abs(parts - whole)[seen].mean() < 0.01
    for along in (0, 1):
        steps = np.abs(np.diff(parts[..., :3], axis=along)).mean(axis=(1 - along, 2))
        at_borders = steps[[255, 511]].mean()
        inside = steps[[i for i in range(8, 759) if abs((i + 1) % 256) > 4]]
        spread = inside.std() / math.sqrt(2)
        assert at_borders == pytest.approx(inside.mean(), abs=0.1 + 3 * spread)


@pytest.mark.long
def test_steps_at_borders_are_those_inside() -> None:
    """Over many borders of smooth ground, where a step of a tenth of a grey level would show."""
    laid = island(WIDE)
    shown = pyramid(laid, longest=300.0)
    level = laid.levels[1]
    x, y = tile_at(laid, level)
    there = [[shown.tile(level, x + i, y + j) for i in range(-4, 5)] for j in range(-4, 5)]
    nothing = np.zeros((256, 256, 4), np.uint8)
    whole = np.vstack([np.hstack([nothing if one is None else one for one in row]) for row in there]).astype(float)
    for along in (0, 1):
        moved = np.moveaxis(whole, along, 0)
        seen = (moved[1:, :, 3] == 255) & (moved[:-1, :, 3] == 255)
        steps = np.abs(np.diff(moved[..., :3], axis=0)).mean(axis=2)
        is_border = np.zeros(len(steps), bool)
        is_border[255::256] = True
        # Beside each border the rows next to it, which show the same ground.
        beside = np.roll(is_border, 1) | np.roll(is_border, -1)
        at_borders, inside = (steps[rows][seen[rows]].mean() for rows in (is_border, beside))
        assert seen[is_border].sum() > 5000
        assert at_borders == pytest.approx(inside, abs=0.1)


@pytest.mark.long
def test_levels_show_the_same() -> None:
    """The mean of four pixels is that of the level above: nothing shifts and nothing gets darker from level to level."""
    laid = island(WIDE)
    shown, compared = pyramid(laid, longest=3000.0), 0
    for level in range(laid.levels[1] - 5, laid.levels[1] + 2):
        x, y = tile_at(laid, level - 1, 500.0, 500.0)
        coarse = sure(shown.tile(level - 1, x, y)).astype(float)
        four = [[shown.tile(level, 2 * x + i, 2 * y + j) for i in range(2)] for j in range(2)]
        nothing = np.zeros((256, 256, 4), np.uint8)
        fine = np.vstack([np.hstack([nothing if one is None else one for one in row]) for row in four]).astype(float)
        mean = fine.reshape(256, 2, 256, 2, 4).mean(axis=(1, 3))
        seen = (mean[..., 3] == 255) & (coarse[..., 3] == 255)
        if seen.sum() > 200:
            compared += 1
            assert abs((coarse - mean)[seen].mean()) < 0.1
            assert np.abs(coarse - mean)[seen].max() < 4.0
    assert compared >= 5


@pytest.mark.long
def test_borders_of_the_map_are_neither_dark_nor_light() -> None:
    laid = island()
    shown = pyramid(laid, longest=1e9)  # one colour
    for level in range(laid.levels[0], laid.levels[1] + 3, 2):
        for x, y in shown.tiles(level):
            tile = shown.tile(level, x, y)
            if tile is not None:
                visible = tile[tile[..., 3] > 60][:, :3].astype(int)
                off = np.abs(visible - waves(np.zeros(2), 1e9)).max(initial=0)
                assert off < 255 / 60 + 1  # what rounding leaves at so little coverage


def test_of_islands_that_overlap_the_one_with_most_frames_is_on_top() -> None:
    entries = [
        {"id": 4, "frames": 50, "bounds": [-500, -500, 500, 500], "minzoom": 13, "maxzoom": 16},
        {"id": 2, "frames": 9, "bounds": [-1500, -500, 1500, 500], "minzoom": 13, "maxzoom": 16},
        {"id": 7, "frames": 70, "bounds": [-9, -9, 9, 9], "minzoom": 13, "maxzoom": 16, "merged_into": 4},
        {"id": 8, "frames": 70, "bounds": [-9, -9, 9, 9], "minzoom": 13, "maxzoom": 16},
    ]
    laid = earth_islands(canvas_islands({"islands": entries}), {4: anchor(), 2: anchor(), 7: anchor()})
    assert [one.id for one in laid] == [2, 4]

    def canvas(one: object, _tile: object) -> np.ndarray:
        colour = 40 if one is laid[0] else 200
        return np.dstack([np.full((256, 256, 3), colour, np.uint8), np.full((256, 256), 255, np.uint8)])

    shown = GeoPyramid(laid, canvas)
    level = laid[1].levels[1] - 1
    tile = sure(shown.tile(level, *tile_at(laid[1], level)))
    mixed = np.isin(tile[tile[..., 3] == 255][:, 0], (40, 200), invert=True)
    assert mixed.mean() < 0.05  # along the border of the one on top
    middle = shown.tile(laid[1].levels[1], *tile_at(laid[1], laid[1].levels[1]))
    assert (sure(middle)[..., 0] == 200).mean() > 0.5
    alone = sure(shown.only(2).tile(level, *tile_at(laid[1], level)))
    assert set(np.unique(alone[alone[..., 3] == 255][:, 0])) == {40}
    assert shown.only(9).tile(level, 0, 0) is None


def test_the_180th_meridian_is_no_border() -> None:
    laid = island(laid=anchor(longitude=180.0, latitude=-17.0))
    shown = pyramid(laid)
    level = laid.levels[1]
    count, y = 1 << level, tile_at(laid, level)[1]
    west, east = sure(shown.tile(level, count - 1, y)), sure(shown.tile(level, 0, y))
    both = np.hstack([west, east]).astype(float)
    assert np.abs(np.diff(both[..., :3], axis=1))[:, 255].mean() < 3
    assert (both[..., 3] == 255).mean() > 0.3
    assert {0, count - 1} <= {x for x, _ in shown.tiles(level)}
    bounds = sure(shown.bounds)
    assert (bounds[0], bounds[2]) == (-180.0, 180.0)
    assert sure(shown.mercator_bounds)[2] == HALF_WORLD_M


@pytest.mark.parametrize("longitude", [180.0, -179.9999, 179.9999])
def test_beyond_the_180th_meridian_longitudes_go_on(longitude: float) -> None:
    """Whichever corner of the island lies on which side."""
    laid = island(laid=anchor(longitude=longitude, latitude=-17.0, turned_deg=-52.0))
    beside = island(id=1, laid=anchor(longitude=-179.99, latitude=-17.0))
    assert 179.9 < laid.bounds[0] < 180 < laid.bounds[2] < 180.1
    shown = pyramid(laid, beside)
    west, _, east, _ = sure(shown.reach)
    assert 179.9 < west < 180 < 180.01 < east < 180.1
    assert abs(abs(sure(shown.middle)[0]) - 180) < 0.01
    plain = pyramid(island(), island(id=1, laid=anchor(longitude=-7.0)))
    assert plain.reach == plain.bounds


@pytest.mark.long
def test_every_tile_that_shows_something_is_listed() -> None:
    laid = island()
    shown = pyramid(laid)
    for level in range(laid.levels[0], laid.levels[1] + 1):
        listed = list(shown.tiles(level))
        assert len(listed) == len(set(listed))
        x, y = listed[0]
        around = {(x + i, y + j) for i in range(-2, 8) for j in range(-2, 8)}
        there = {place for place in around if shown.tile(level, *place) is not None}
        assert there <= set(listed)


def test_a_map_without_an_island_is_empty() -> None:
    shown = GeoPyramid((), noisy())
    assert (shown.levels, shown.bounds, shown.mercator_bounds, list(shown.tiles(3))) == (None, None, None, [])
    assert shown.tile(0, 0, 0) is None


def test_places_outside_the_grid_are_empty() -> None:
    shown = pyramid()
    level = sure(shown.levels)[1]
    for x, y in ((-1, 0), (0, -1), (1 << level, 0), (0, 1 << level)):
        assert shown.tile(level, x, y) is None


def test_the_finest_level_is_the_nearest_to_the_ground_s_pixels() -> None:
    for gsd, latitude in ((0.02, 44.5), (0.1, 0.0), (0.3, 70.0)):
        laid = island(laid=anchor(gsd_m=gsd, latitude=latitude))
        on_ground = resolution_m(laid.levels[1]) * math.cos(math.radians(latitude))
        assert 2**-0.51 < on_ground / gsd < 2**0.51


def test_an_island_far_from_what_its_anchor_was_made_of_is_left_out() -> None:
    entry = {"id": 0, "frames": 1, "bounds": [-6e6, -9, 9, 9], "minzoom": 1, "maxzoom": 16}
    assert earth_islands(canvas_islands({"islands": [entry]}), {0: anchor()}) == ()
