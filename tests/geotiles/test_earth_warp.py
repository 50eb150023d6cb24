"""Where a pixel of a geo tile is taken from, against PROJ; and what is made of it."""

from __future__ import annotations

import numpy as np
import pytest
from pyproj import Transformer

from gcs_mosaic.geo.anchor import Anchor
from gcs_mosaic.geo.mercator import mercator, resolution_m
from gcs_mosaic.geotiles.earth_islands import EarthIsland
from gcs_mosaic.geotiles.picture_grid import PictureGrid, grid_of_tile
from gcs_mosaic.geotiles.pyramid import OVERZOOM, GeoPyramid
from gcs_mosaic.geotiles.warp import sampling_of, source_places, windows
from gcs_mosaic.render.tile_grid import canvas_from_level, pixel_size
from gcs_mosaic.stitch.arrays import Array
from tests.geotiles.ground import anchor, island, noisy, pyramid, waves
from tests.sure import sure
from tests.tiers import thorough

KM = 10_000.0  # canvas units at 0.1 m
SMALL, LARGE = (-1000.0, -800.0, 1000.0, 800.0), (-15 * KM, -10 * KM, 15 * KM, 10 * KM)


def tile_at(laid: EarthIsland, level: int, x: float = 0.0, y: float = 0.0) -> tuple[int, int]:
    """The tile in which a canvas place lies."""
    east, north = mercator(laid.anchor.places(np.array([x, y]))).tolist()
    side = resolution_m(level) * 256
    return int((east + 128 * resolution_m(0)) // side), int((128 * resolution_m(0) - north) // side)


def by_proj(laid: Anchor, points: Array) -> Array:
    """Canvas places of points of Web Mercator, by PROJ alone."""
    plane = laid.plane
    down = f"+lon_0={plane.longitude_deg} +lat_0={plane.latitude_deg} +h_0=0"
    to_plane = Transformer.from_pipeline(
        "+proj=pipeline +step +inv +proj=webmerc +ellps=WGS84 +step +proj=cart +ellps=WGS84 "
        f"+step +proj=topocentric +ellps=WGS84 {down}"
    )
    east, north, _ = to_plane.transform(points[..., 0], points[..., 1], np.zeros(points.shape[:-1]))
    back = (east + 1j * north - laid.shift) / laid.turn
    return np.stack([back.real, -back.imag], axis=-1)


@pytest.mark.long
@pytest.mark.parametrize("latitude", [-33.0, 70.0, *map(thorough, (0.0, 44.5, 60.0, 65.0))])
@pytest.mark.parametrize("box", [SMALL, LARGE], ids=["small", "30 km"])
def test_every_pixel_is_taken_from_where_proj_says(latitude: float, box: tuple[float, float, float, float]) -> None:
    """At all levels, in tiles of the middle and of a corner, to 0.05 pixels of the tile."""
    laid = island(box, finest=16, laid=anchor(latitude=latitude, turned_deg=37.0))
    coarsest, finest = laid.levels
    worst = 0.0
    for level in range(coarsest, finest + 1):
        for spot in ((0.0, 0.0), (box[0], box[1])):
            grid = grid_of_tile(level, *tile_at(laid, level, *spot))
            sampling = sampling_of(grid, laid)
            for window in windows(grid, laid):
                found = source_places(grid, window, laid, sampling)
                across, down = sampling.across, sampling.down
                x = window.left + (np.arange(found.x.shape[1]) + 0.5) / across
                y = window.top + (np.arange(found.x.shape[0]) + 0.5) / down
                points = np.stack(
                    np.meshgrid(grid.bounds[0] + x * grid.steps[0], grid.bounds[3] - y * grid.steps[1]), axis=-1
                )
                read = np.stack([found.x, found.y], axis=-1).astype(np.float64) + np.array([found.left, found.top])
                canvas = canvas_from_level(sampling.level, read)
                pixel = grid.ground_m(latitude)[0] / laid.anchor.metres_per_unit  # canvas units
                worst = max(worst, float(np.abs(canvas - by_proj(laid.anchor, points)).max()) / pixel)
    assert worst < 0.05, worst


def test_the_level_that_is_read_is_one_to_two_times_as_fine() -> None:
    laid = island(LARGE)
    for level in range(*laid.levels):
        grid = grid_of_tile(level, *tile_at(laid, level))
        read = sampling_of(grid, laid)
        times = grid.ground_m(laid.latitude_deg)[0] / 0.1 / pixel_size(read.level)
        assert 0.999 <= times <= (8.6 if read.level == 0 else 2.001)
        if read.level == 0:  # the whole island is a few pixels
            continue
        assert read.across == read.down == (1 if times < 1.001 else 2)


def test_what_it_shows_lies_where_the_anchor_says() -> None:
    """Each pixel has the colour of its place on the ground, to what rounding and a mean over its area leave."""
    laid = island()
    shown = pyramid(laid, longest=1000.0)
    for level in range(laid.levels[1] - 3, laid.levels[1] + 3):
        x, y = tile_at(laid, level, 200.0, -300.0)
        tile = sure(shown.tile(level, x, y))
        grid = grid_of_tile(level, x, y)
        middles = np.arange(256.0) + 0.5
        truth = waves(laid.anchor.canvas(grid.places(middles, middles)), 1000.0)
        inside = tile[..., 3] == 255
        assert inside.mean() > 0.1
        off = np.abs(tile[..., :3].astype(float) - truth)[inside]
        assert off.max() < 3.0
        assert off.mean() < 0.6


@pytest.mark.long
@pytest.mark.parametrize("up", [0, thorough(1), 3])
def test_nothing_finer_than_a_pixel_shimmers(up: int) -> None:
    """Noise that is independent from pixel to pixel becomes fainter as its mean over a pixel does: aliased, it would not."""
    laid = island((-4000.0, -4000.0, 4000.0, 4000.0))
    level = laid.levels[1] - up
    tile = sure(GeoPyramid((laid,), noisy()).tile(level, *tile_at(laid, level)))
    pixels = (grid_of_tile(level, 0, 0).ground_m(laid.latitude_deg)[0] / 0.1) ** 2  # of the canvas in one of the tile
    contrast = tile[tile[..., 3] == 255][:, :3].astype(float).std()
    assert contrast < 1.1 * 40 / max(np.sqrt(pixels), 1.0) + 0.6  # rounding


def test_beyond_the_finest_level_it_is_enlarged_and_then_ends() -> None:
    laid = island()
    shown, finest = pyramid(laid), laid.levels[1]
    assert shown.levels == laid.levels
    for level in (finest + 1, finest + OVERZOOM):
        assert sure(shown.tile(level, *tile_at(laid, level))).min(axis=(0, 1))[3] == 255
    level = finest + OVERZOOM + 1
    assert shown.tile(level, *tile_at(laid, level)) is None
    level = laid.levels[0] - 1
    assert shown.tile(level, *tile_at(laid, level)) is None


def test_from_afar_it_is_a_dot() -> None:
    laid = island()
    level = laid.levels[0]
    tile = sure(pyramid(laid).tile(level, *tile_at(laid, level)))
    assert 1 <= (tile[..., 3] > 20).sum() <= 9
    assert level <= 12


def test_unequal_pixels_are_sampled_along_their_longer_side() -> None:
    laid = island()
    west, south, east, north = laid.bounds
    grid = PictureGrid("degrees", (west, south, east, north), 400, 50)
    read = sampling_of(grid, laid)
    assert read.down > read.across
    picture = sure(pyramid(laid, longest=3000.0).picture(grid))
    truth = waves(laid.anchor.canvas(grid.places(np.arange(400.0) + 0.5, np.arange(50.0) + 0.5)), 3000.0)
    inside = picture[..., 3] == 255
    assert np.abs(picture[..., :3].astype(float) - truth)[inside].mean() < 1.0
    extreme = PictureGrid("degrees", (west, south - 40, east, north + 40), 8, 8)
    assert sampling_of(extreme, laid).down == 8
