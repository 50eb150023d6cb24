"""Frames of any number of bands, at eight or sixteen bits, through the folding of tiles."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import Any

import cv2
import numpy as np
import pytest
from painting_parts import painted, picture

from gcs_mosaic.render.compositor import CompositorSettings, TileCompositor
from gcs_mosaic.render.display import Display
from gcs_mosaic.render.pyramid import TilePicture
from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.render.tile_grid import Tile, tiles_over
from tests.sure import sure

Canvases = Callable[..., TileCompositor]  # makes one by how it gets frames, its settings and more
FIVE = Display((0, 1, 2), (0,) * 5, (65_535,) * 5)


@pytest.fixture
def canvas() -> Iterator[Canvases]:
    """Makes canvases, and closes them in the end."""
    with ExitStack() as stack:
        yield lambda load, settings=None, **more: stack.enter_context(TileCompositor(load, settings, **more))


def five(name: str) -> np.ndarray:
    """Five bands of 16 bits: the colours of `picture` times 257, and two that are the first one's, halved and turned over."""
    colour = picture(int(name.removesuffix(".jpg"))).astype(np.uint16) * 257
    return np.dstack([colour, colour[..., 0] // 2, 65_535 - colour[..., 0]])


def flight(**more: Any) -> list[RenderItem]:
    """Frames of two resolutions, so that overviews are made too."""
    return [painted(i, 45.0 * i, 20.0 * i, gsd=(1.0, 2.3)[i % 2], yaw=0.7 * i, pitch=0.1, **more) for i in range(5)]


def all_tiles(c: TileCompositor) -> dict[Tile, TilePicture]:
    box, coarsest, finest = sure(c.extent(0))
    tiles = (tile for level in range(coarsest, finest + 1) for tile in tiles_over(box, level))
    return {tile: shown for tile in tiles if (shown := c.tile(0, tile)) is not None}


@pytest.mark.parametrize("blend", ["edge", "newest", "first"])
def test_all_bands_are_painted_as_the_colours_are(canvas: Canvases, blend: str) -> None:
    """Same places, same shares, through the store and the overviews; rounding is finer by the depth."""
    c = canvas(five, CompositorSettings(memory_mb=1, blend=blend), keep_bands="raw")
    for frame in flight(gain=(1.0,) * 5, display=FIVE):
        c.paint(five(frame.name), frame)
    tiles = all_tiles(c)
    assert len(tiles) > 8
    for tile in tiles.values():
        bands = sure(tile.bands)
        assert bands.dtype == np.uint16
        np.testing.assert_allclose(bands[..., :3] / 257, tile.colour, atol=3)  # as many roundings as frames
        np.testing.assert_allclose(bands[..., 3], bands[..., 0] / 2, atol=3)
        known = tile.coverage > 0
        np.testing.assert_allclose(bands[known][:, 4], 65_535.0 - bands[known][:, 0], atol=3)
        assert (bands[~known] == 0).all()


def test_bands_are_cut_where_the_colours_are(canvas: Canvases) -> None:
    """Also where tones are shifted at seams, which is for the eye and leaves the bands as they are."""

    def numbered(name: str) -> np.ndarray:
        return np.full((120, 160, 5), 1000 * (1 + int(name.removesuffix(".jpg"))), np.uint16)

    def structured(name: str) -> np.ndarray:
        return np.dstack([five(name)[..., :4], numbered(name)[..., 4]])

    c = canvas(structured, keep_bands="raw")
    frames = [painted(i, 45.0 * i, 20.0 * i, yaw=0.7 * i, gain=(1.0,) * 5, display=FIVE) for i in range(3)]
    for frame in frames:
        c.paint(structured(frame.name), frame)
    for i, frame in enumerate(frames):
        alone = canvas(structured, keep_bands="raw")
        alone.paint(structured(frame.name), frame)
        for tile, shown in all_tiles(c).items():
            own = alone.tile(0, tile)
            bands = sure(shown.bands)
            mine = bands[..., 4] == 1000 * (i + 1)
            if own is not None and tile.z == frame.level:
                off = np.abs(bands[mine].astype(int) - sure(own.bands)[mine])
                assert off.max(initial=0) <= 1
                assert np.abs(shown.colour[mine].astype(int) - own.colour[mine]).max(initial=0) <= 40


def test_bands_are_those_of_a_rebuild(canvas: Canvases) -> None:
    step_by_step, rebuilt = (canvas(five, keep_bands="gained") for _ in range(2))
    frames = flight(gain=(1.0, 1.1, 0.9, 1.3, 0.8), display=FIVE)
    for frame in reversed(frames):
        step_by_step.paint(five(frame.name), frame)
    list(step_by_step.repaint())
    for frame in frames:
        rebuilt.paint(five(frame.name), frame)
    here, there = all_tiles(step_by_step), all_tiles(rebuilt)
    assert here.keys() == there.keys()
    assert all(np.array_equal(sure(here[tile].bands), sure(there[tile].bands)) for tile in here)


def test_what_is_shown_does_not_depend_on_whether_bands_are_kept(canvas: Canvases) -> None:
    shown = []
    for keep in ("none", "raw", "gained"):
        c = canvas(five, keep_bands=keep)
        for frame in flight(gain=(1.2,) * 5, display=FIVE):
            c.paint(five(frame.name), frame)
        shown.append(all_tiles(c))
    assert all(tile.bands is None for tile in shown[0].values())
    for kept in shown[1:]:
        assert all(np.array_equal(kept[tile].colour, shown[0][tile].colour) for tile in shown[0])


def test_a_single_band_is_painted_as_grey(canvas: Canvases) -> None:
    def one(name: str) -> np.ndarray:
        return cv2.cvtColor(picture(0), cv2.COLOR_BGR2GRAY)[..., None].astype(np.uint16) * 4 + 28_000

    c = canvas(one, keep_bands="raw")
    c.paint(one(""), painted(0, 79.5, 59.5, gain=(1.0,), display=Display((0, 0, 0), (28_000,), (29_020,))))
    tile = sure(c.tile(0, max(all_tiles(c), key=lambda tile: tile.z)))
    bands = sure(tile.bands)
    assert bands.shape == (256, 256, 1)
    assert (tile.colour == tile.colour[..., :1]).all()
    known = tile.coverage > 0
    np.testing.assert_allclose(bands[known][:, 0] / 4 - 7000, tile.colour[known][:, 0], atol=0.6)


def test_a_frame_of_other_bands_than_its_display_is_refused(canvas: Canvases) -> None:
    with pytest.raises(ValueError, match=r"0.jpg is \(120, 160, 5\) uint16"):
        canvas(five).paint(five("0.jpg"), painted(0))
