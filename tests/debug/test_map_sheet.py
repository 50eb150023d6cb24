"""Footprints, links and misses lie on the picture where they lie on the canvas."""

import numpy as np
import pytest

from gcs_mosaic.debug.map_sheet import HEAD, LONGER_SIDE, MARGIN, MapSheet, draw_footprints, draw_residuals
from gcs_mosaic.debug.sheet import PAPER
from gcs_mosaic.stitch.arrays import Array, ImageBGR
from gcs_mosaic.stitch.graph.observer import Residuals
from gcs_mosaic.stitch.graph.placement import Placement


def ink(picture: ImageBGR, places: Array) -> list[bool]:
    """Whether there is ink within two pixels of places (n, 2) on the sheet."""
    dark = np.asarray((np.abs(picture.astype(int) - PAPER) > 25).any(axis=2))
    return [bool(dark[y - 2 : y + 3, x - 2 : x + 3].any()) for x, y in np.rint(places).astype(int).tolist()]


def test_the_canvas_fills_the_sheet(two_placements: list[Placement]) -> None:
    island = MapSheet(two_placements, "")
    corners = island.at(np.array([[-0.5, -0.5], [599.5, 299.5]]))
    assert corners == pytest.approx(
        np.array([[MARGIN, MARGIN + HEAD], [MARGIN + LONGER_SIDE, MARGIN + HEAD + LONGER_SIDE / 2]]), abs=3
    )
    assert island.middles() == pytest.approx(island.at(np.array([[200.0, 150], [400, 150]])), abs=0.1)


def test_footprints_are_outlined_and_links_drawn(two_placements: list[Placement]) -> None:
    picture, at = draw_footprints(two_placements), MapSheet(two_placements, "").at
    on_outlines = np.array([[100, -0.5], [-0.5, 100], [199.5, 70], [399.5, 80], [599.5, 200], [500, 299.5]])
    assert all(ink(picture, at(on_outlines)))
    assert all(ink(picture, at(np.array([[250.0, 150], [300, 150], [350, 150]]))))  # the link between the middles
    assert not any(ink(picture, at(np.array([[100.0, 80], [300, 80], [500, 220], [300, 220]]))))  # empty ground
    first, last = (
        picture[tuple(np.rint(at(np.array([place]))[0]).astype(int)[::-1])] for place in ([-0.5, 100], [599.5, 200])
    )
    assert first[0] > first[2]  # blue
    assert last[2] > last[0]  # red


def test_misses_point_where_the_other_frame_shows_the_point(two_placements: list[Placement]) -> None:
    places = np.array([[300.0, 100], [300, 200], [350, 60]])
    misses = np.array([[2.0, 0], [0, 2], [np.nan, np.nan]])
    residuals = [Residuals("a/one.jpg", places, misses), Residuals("a/two.jpg", places + misses, -misses)]
    picture, at = draw_residuals(two_placements, residuals), MapSheet(two_placements, "").at
    right, down = np.array([[308.0, 100], [314, 100]]), np.array([[300.0, 208], [300, 214]])
    assert all(ink(picture, at(right)))
    assert all(ink(picture, at(down)))
    assert not any(ink(picture, at(np.array([[300.0, 85], [310, 115], [350, 60]]))))
