import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_mosaic.render import tile_grid as grid
from gcs_mosaic.render.tile_grid import Tile
from tests.tile_parts import pixel_centres

levels = st.integers(0, grid.FINEST_LEVEL)
inside = st.floats(-(2.0**22), 2.0**22)
tiles = st.builds(lambda z, x, y: Tile(z, x % (1 << z), y % (1 << z)), levels, st.integers(0), st.integers(0))


@given(levels, inside, inside)
def test_canvas_to_level_and_back(level: int, x: float, y: float) -> None:
    places = np.array([x, y])
    back = grid.canvas_from_level(level, grid.level_from_canvas(level, places))
    np.testing.assert_allclose(back, places, atol=1e-8)


def test_at_the_base_level_pixel_centres_are_the_whole_canvas_units() -> None:
    middle = Tile(grid.BASE_LEVEL, 1 << 15, 1 << 15)
    centres = pixel_centres(middle)
    np.testing.assert_array_equal(centres[0, 0], [0, 0])
    np.testing.assert_array_equal(centres[3, 255], [255, 3])


@given(tiles)
def test_a_tile_is_its_children_put_together(tile: Tile) -> None:
    boxes = [grid.tile_box(child) for child in tile.children]
    assert grid.join(boxes[0], boxes[3]) == grid.tile_box(tile) == grid.join(boxes[1], boxes[2])
    assert all(child.parent == tile for child in tile.children)
    assert all(grid.ancestor(child, tile.z) == tile for child in tile.children)


@given(tiles)
def test_a_tiles_own_box_touches_that_tile_only(tile: Tile) -> None:
    assert list(grid.tiles_over(grid.tile_box(tile), tile.z)) == [tile]


@pytest.mark.long
@given(st.integers(8, 20), inside, inside, st.floats(0.1, 3000), st.floats(0.1, 3000))
def test_tiles_over_a_box_hold_its_corners_and_no_more_than_needed(
    level: int, x: float, y: float, width: float, height: float
) -> None:
    found = list(grid.tiles_over((x, y, x + width, y + height), level))
    side = grid.TILE_SIZE * grid.pixel_size(level)
    boxes = [grid.tile_box(t) for t in found]
    assert min(b[0] for b in boxes) <= x < x + width <= max(b[2] for b in boxes)
    assert min(b[1] for b in boxes) <= y < y + height <= max(b[3] for b in boxes)
    assert len(found) <= (width / side + 2) * (height / side + 2)


@pytest.mark.parametrize(
    ("gsd", "usual", "level"),
    [
        (1.5, 1.5, 16),
        (1.7, 1.7, 15),
        (1.5, 1.7, 15),
        (1.7, 1.5, 16),
        (1.3, 1.7, 16),  # too much would be lost
        (1.9, 1.5, 15),  # too much would be painted
        (1.5, 9.0, 16),
        (1.7, 0.1, 15),
    ],
)
def test_a_frame_is_painted_at_the_level_of_the_others_if_it_suits_it_nearly(
    gsd: float, usual: float, level: int
) -> None:
    assert grid.level_among(gsd, usual) == level


@given(st.floats(0.01, 1000))
def test_the_painting_level_is_the_coarsest_that_loses_little(gsd: float) -> None:
    level = grid.painting_level(gsd)
    assert 1 - gsd / grid.pixel_size(level) <= grid.RESOLUTION_LOSS + 1e-6
    assert 1 - gsd / grid.pixel_size(level - 1) >= grid.RESOLUTION_LOSS - 1e-6


def test_the_first_frame_is_painted_pixel_for_pixel() -> None:
    assert grid.painting_level(1.0) == grid.BASE_LEVEL


@pytest.mark.parametrize("gsd", [0.0, -1.0, math.nan, math.inf])
def test_a_resolution_that_is_none_is_refused(gsd: float) -> None:
    with pytest.raises(ValueError, match="positive"):
        grid.painting_level(gsd)


@given(inside, inside, st.floats(1, 1e5), st.floats(1, 1e5))
def test_at_the_overview_level_two_by_two_tiles_hold_a_box(x: float, y: float, width: float, height: float) -> None:
    box = (x, y, x + width, y + height)
    level = grid.overview_level(box, 16)
    assert len({t.x for t in grid.tiles_over(box, level)}) <= 2
    assert len({t.y for t in grid.tiles_over(box, level)}) <= 2
    finer = list(grid.tiles_over(box, level + 1))
    assert level == 16 or max(len({t.x for t in finer}), len({t.y for t in finer})) > 2


def test_places_that_are_nowhere_do_not_count() -> None:
    assert grid.box_of(np.array([[1.0, 2.0], [np.nan, 5.0], [3.0, 0.0]])) == (1.0, 0.0, 3.0, 2.0)
    assert grid.box_of(np.full((3, 2), np.nan)) is None
