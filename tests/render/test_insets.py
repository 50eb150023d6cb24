"""Frames flown at different heights over one ground: the finer show, but for what only the coarser have seen."""

from collections.abc import Iterable
from dataclasses import replace
from functools import cache
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from painting_parts import painted

from gcs_mosaic.render.cells import Window
from gcs_mosaic.render.compositor import CompositorSettings, TileCompositor
from gcs_mosaic.render.frame_warp import frame_warp, on_level
from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.render.territory import Territory
from gcs_mosaic.render.tile_grid import Tile
from gcs_mosaic.render.warp_grid import frame_lattice
from gcs_mosaic.stitch.camera.geometry import Camera
from tests.tiers import thorough

CAMERA = Camera(640, 480, focal=1.2)
SIDE = 2600  # pixels of the ground at level 16, which begins at the canvas' (0, 0)
MIDDLE = 1 << 15
FINE, HALF, QUARTER = 1, 2, 4  # ground pixels in a frame's
PERSON = 640, 620  # where on the ground
RED = (60, 60, 220)


@cache
def bare() -> np.ndarray:
    rough = np.random.default_rng(2).normal(100, 12, (SIDE // 4, SIDE // 4, 3)).astype(np.float32)
    whole = cv2.resize(rough, (SIDE, SIDE), interpolation=cv2.INTER_CUBIC)
    return np.clip(whole + np.random.default_rng(3).normal(0, 4, (SIDE, SIDE, 1)), 0, 255).astype(np.uint8)


def ground(things: Iterable[tuple[int, int, int]] = ()) -> np.ndarray:
    """With red squares (x, y, side)."""
    whole = bare().copy()
    for x, y, side in things:
        whole[y : y + side, x : x + side] = RED
    return whole


def with_bush(wide: float) -> np.ndarray:
    """Dark, and without any edge."""
    x, y = (np.exp(-(((np.arange(SIDE) - at) / wide) ** 2) / 2) for at in PERSON)
    return np.asarray(np.clip(bare() - 80 * (y[:, None] * x)[..., None], 0, 255), np.uint8)


def flown(order: int, x: int, y: int, gsd: int, seen: np.ndarray, **more: Any) -> tuple[RenderItem, np.ndarray]:
    """A frame, and its picture, whose left top corner is at a ground pixel."""
    width, height = CAMERA.width * gsd, CAMERA.height * gsd
    part = seen[y : y + height, x : x + width]
    image = cv2.resize(part, (CAMERA.width, CAMERA.height), interpolation=cv2.INTER_AREA)
    at = x + (width - 1) / 2, y + (height - 1) / 2
    return painted(order, *at, gsd=gsd, camera=CAMERA, level=16 - int(np.log2(gsd)), **more), image


def tiles_at_16(canvas: TileCompositor) -> np.ndarray:
    """Four by four tiles of the finest level."""
    empty = np.zeros((256, 256, 3), np.uint8)
    shown = [[canvas.tile(0, Tile(16, MIDDLE + x, MIDDLE + y)) for x in range(5)] for y in range(4)]
    return np.vstack([np.hstack([empty if one is None else one.colour for one in row]) for row in shown])


def mosaic(frames: list[tuple[RenderItem, np.ndarray]]) -> np.ndarray:
    images = {frame.name: image for frame, image in frames}
    with TileCompositor(images.get, CompositorSettings()) as canvas:
        for frame, image in frames:
            canvas.paint(image, frame)
        list(canvas.repaint())
        return tiles_at_16(canvas)


def overview(frames: list[tuple[RenderItem, np.ndarray]]) -> np.ndarray:
    """Two by two tiles of the level above the finest."""
    images = {frame.name: image for frame, image in frames}
    with TileCompositor(images.get, CompositorSettings()) as canvas:
        canvas.move([frame for frame, _ in frames])
        list(canvas.repaint())
        tiles = [[canvas.tile(0, Tile(15, (MIDDLE >> 1) + x, (MIDDLE >> 1) + y)) for x in range(2)] for y in range(2)]
        return np.vstack([np.hstack([one.colour for one in row if one is not None]) for row in tiles])


def red(picture: np.ndarray, x: int, y: int, side: int) -> float:
    """The share of a square that is red, by at least half of what it was."""
    part = picture[y : y + side, x : x + side].astype(int)
    return float(((part[..., 2] - part[..., 1]) > 80).mean())


def covered(picture: np.ndarray) -> NDArray[np.uint8]:
    return np.asarray(picture.any(axis=2), np.uint8)


def finer_ones(seen: np.ndarray, first: int) -> list[tuple[RenderItem, np.ndarray]]:
    places = [(200, 260), (420, 340), (560, 420)]
    return [flown(first + i, x, y, FINE, seen) for i, (x, y) in enumerate(places)]


@pytest.mark.long
@pytest.mark.parametrize("gsd", [HALF, QUARTER])
@pytest.mark.parametrize("high_first", [True, False])
def test_somebody_seen_once_from_high_up_stays_on_the_map(gsd: int, high_first: bool) -> None:
    side = 6 * gsd
    high = flown(0 if high_first else 9, 0, 0, gsd, ground([(*PERSON, side)]))
    near = finer_ones(ground(), 1)
    shown = mosaic([high, *near] if high_first else [*near, high])
    assert red(shown, *PERSON, side) > 0.9
    without = mosaic(near)
    covered = without.any(axis=2)
    other = (np.abs(shown.astype(int) - without).max(axis=2) > 8) & covered
    assert other.sum() < (side + 2 * 20 * gsd) ** 2, "all else is as fine as it was"


def test_a_finer_frame_fades_into_coarser_ones_where_an_inset_shows_somebody_too() -> None:
    """The border of a brighter frame runs through the tile of a person that only the coarser frame has seen."""
    x, y = PERSON
    near = flown(1, 200, 260, FINE, ground() + np.uint8(30))
    one, nobody = (overview([flown(0, 0, 0, HALF, ground(who)), near]) for who in ([(*PERSON, 12)], []))
    assert red(one, x // 2, y // 2, 6) > 0.9
    other = np.abs(one.astype(int) - nobody).max(axis=2) > 8  # tones change a little around them
    other[y // 2 - 20 : y // 2 + 26, x // 2 - 20 : x // 2 + 26] = False
    assert not other.any(), "all else is as if nobody were there"


def test_two_frames_from_high_up_show_somebody_once() -> None:
    side = 6 * HALF
    high = [flown(i, 20 * i, 10 * i, HALF, ground([(*PERSON, side)])) for i in (0, 7)]
    shown = mosaic([high[0], *finer_ones(ground(), 1), high[1]])
    assert red(shown, *PERSON, side) > 0.9
    assert red(shown, 200, 260, 800) < 2 * side**2 / 800**2


@pytest.mark.parametrize("side", [8, 24, 40, 60, 90, 140, 200])
@pytest.mark.parametrize("gsd", [HALF, QUARTER])
def test_what_stands_there_is_shown_as_the_finer_frames_see_it(gsd: int, side: int) -> None:
    """A car, or a roof, seen by all."""
    scene = ground([(*PERSON, side)])
    near = finer_ones(scene, 1)
    shown, without = mosaic([flown(0, 0, 0, gsd, scene), *near]), mosaic(near)
    inside = cv2.erode(covered(without), np.ones((41, 41))) > 0
    np.testing.assert_array_equal(shown[inside], without[inside])


@pytest.mark.long
@pytest.mark.parametrize("wide", [10, 45, *map(thorough, (20, 30))])
@pytest.mark.parametrize("gsd", [HALF, QUARTER])
def test_what_has_no_edge_stands_out_from_high_up_alone_and_is_shown_as_the_finer_see_it(gsd: int, wide: int) -> None:
    near = finer_ones(with_bush(wide), 1)
    shown, without = mosaic([flown(0, 0, 0, gsd, with_bush(wide)), *near]), mosaic(near)
    inside = cv2.erode(covered(without), np.ones((41, 41))) > 0
    np.testing.assert_array_equal(shown[inside], without[inside])


def test_what_moved_a_little_between_is_not_shown_twice() -> None:
    """Places of frames are never quite right, and tall things lean."""
    x, y = PERSON
    shown = mosaic([flown(0, 0, 0, HALF, ground([(x + 14, y - 10, 12)])), *finer_ones(ground([(x, y, 12)]), 1)])
    assert red(shown, 200, 260, 800) < 1.3 * 12**2 / 800**2


@pytest.mark.parametrize("order", [(1, 3, 0, 2), (2, 3, 1, 0), (3, 2, 1, 0), (3, 0, 2, 1)])
def test_guests_are_the_same_whatever_came_first(order: tuple[int, ...]) -> None:
    scene, x, y = ground(), *PERSON
    frames = [
        flown(0, 0, 0, QUARTER, ground([(x, y, 24)])),
        flown(1, 200, 260, FINE, scene),
        flown(2, 40, 60, HALF, ground([(x - 200, y, 14)])),
        flown(3, 420, 340, FINE, scene),
    ]
    np.testing.assert_array_equal(mosaic([frames[i] for i in order]), mosaic(frames))


def test_an_inset_that_moves_or_leaves_takes_what_it_showed_along() -> None:
    x, y = PERSON
    high, moved = (flown(0, 0, 0, HALF, ground([(at, y, 12)])) for at in (x, x - 60))
    near = finer_ones(ground(), 1)
    images = {frame.name: image for frame, image in [high, *near]}
    with TileCompositor(images.get, CompositorSettings()) as canvas:
        for frame, image in [high, *near]:
            canvas.paint(image, frame)
        list(canvas.repaint())
        assert red(tiles_at_16(canvas), x, y, 12) > 0.9
        canvas.move([flown(0, -60 + 60, 0, HALF, ground())[0]])  # where it was: nothing is to be done
        assert canvas.behind == 0
        canvas.move([painted(0, moved[0].pose.x - 60, moved[0].pose.y, gsd=HALF, camera=CAMERA, level=15)])
        list(canvas.repaint())
        assert red(tiles_at_16(canvas), x, y, 12) < 0.1
        assert red(tiles_at_16(canvas), x - 60, y, 12) > 0.9
        canvas.remove([high[0].name])
        list(canvas.repaint())
        np.testing.assert_array_equal(tiles_at_16(canvas), mosaic(near))


def test_insets_are_let_in_again_only_where_something_is_otherwise(monkeypatch: pytest.MonkeyPatch) -> None:
    """First nothing, then a frame that is shown, then the inset: what is as if nobody had known it before."""
    high, near = flown(0, 0, 0, HALF, ground([(*PERSON, 12)])), finer_ones(ground(), 1)
    images = {frame.name: image for frame, image in [high, *near]}
    asked: list[str] = []
    things = Territory._things

    def noted(self: Territory, one: RenderItem) -> object:
        asked.append(one.name)
        return things(self, one)

    monkeypatch.setattr(Territory, "_things", noted)
    moved = replace(near[0][0], pose=replace(near[0][0].pose, x=near[0][0].pose.x + 3.0))
    brighter = replace(high[0], gain=(1.1, 1.1, 1.1))
    with TileCompositor(images.get, CompositorSettings()) as canvas:
        for frame, image in [high, *near]:
            canvas.paint(image, frame)
        list(canvas.repaint())
        asked.clear()
        assert canvas._territory.let_insets_in(canvas._recipes) == set()
        assert not asked
        for other in (moved, brighter):
            canvas.move([other])
            list(canvas.repaint())
            assert set(asked) == {high[0].name}
            asked.clear()
        anew = mosaic([(brighter, high[1]), (moved, near[0][1]), *near[1:]])
        np.testing.assert_array_equal(tiles_at_16(canvas), anew)


def test_an_inset_lies_on_finer_tiles_where_it_lies_on_its_own() -> None:
    frame = frame_warp(painted(0, 700, 500, gsd=HALF, yaw=0.3, pitch=0.1, camera=CAMERA, level=15))
    assert frame is not None
    exact = frame_lattice(frame.painted.pose, CAMERA, 16)
    window = Window(0, 16, MIDDLE + 1, MIDDLE + 1, MIDDLE + 3, MIDDLE + 4)
    inset = on_level(frame, window)
    assert exact is not None
    assert inset is not None
    tile = Tile(16, MIDDLE + 3, MIDDLE + 2)
    one, other = (lattice.pixels[lattice.window(tile)] for lattice in (inset.lattice, exact))
    assert np.abs(one - other).max() < 0.05
    narrow = on_level(frame, Window(0, 16, tile.y, tile.x, tile.y, tile.x))
    assert narrow is not None
    np.testing.assert_array_equal(narrow.lattice.pixels[narrow.lattice.window(tile)], one)
    assert on_level(frame, Window(0, 16, 0, 0, 3, 3)) is None
