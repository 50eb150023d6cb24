"""Frames beside a seam take on a common tone."""

from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np
import pytest
from painting_parts import painted

from gcs_mosaic.render.blend_maps import BlendMaps
from gcs_mosaic.render.cells import CELLS, Window
from gcs_mosaic.render.compositor import TileCompositor
from gcs_mosaic.render.display import PLAIN
from gcs_mosaic.render.frame_warp import frame_warp
from gcs_mosaic.render.seams import look_for_seams
from gcs_mosaic.render.tile_grid import Tile
from gcs_mosaic.render.tone import FINE, MOST_SHIFT, REACH, SQUARES, shifts, wide
from gcs_mosaic.stitch.camera.dead_border import NO_BORDER
from gcs_mosaic.stitch.camera.geometry import Camera
from tests.sure import sure

POOL = ThreadPoolExecutor(2)
CAMERA = Camera(2000, 1000, 1.2)
FRAME = sure(frame_warp(painted(0, 1000.0, 500.0, camera=CAMERA)))
WINDOW = Window(0, 16, 1 << 15, 1 << 15, (1 << 15) + 2, (1 << 15) + 5)
SEAM = 3 * CELLS  # frame 0 shows to the left of it, frame 1 to the right
FIRST = np.where(np.arange(WINDOW.shape[1]) < SEAM, 0, 1)[None].repeat(WINDOW.shape[0], 0).astype(np.int32)


def maps(tone: float, coloured: float = 0.0) -> BlendMaps:
    return BlendMaps((PLAIN, NO_BORDER), (), None, np.full((10, 10, 4), [tone] * 3 + [coloured], np.float16))


def shifted(one: BlendMaps, other: BlendMaps, window: Window = WINDOW) -> list[np.ndarray]:
    """Of both frames, in grey levels, along a row of squares in the window's middle; 0 where they need none."""
    first = FIRST[: window.shape[0], WINDOW.of(window)[1]]
    rows = []
    for there, shift in (shifts(first, window, lambda number: (FRAME, (one, other)[number]), POOL)[k] for k in (0, 1)):
        row = np.zeros(window.shape[1] // 2)
        left = (there.left - window.left) * SQUARES
        row[left : left + shift.shape[2]] = shift[0, shift.shape[1] // 2] / FINE
        rows.append(row)
    return rows


def test_frames_meet_half_way_and_are_left_alone_far_from_the_seam() -> None:
    of_one, of_other = shifted(maps(100), maps(106))
    at = SEAM // 2
    assert of_one[at - 1] == pytest.approx(3, abs=0.7)
    assert of_other[at] == pytest.approx(-3, abs=0.7)
    np.testing.assert_allclose(100 + of_one[at - 3 : at + 3], 106 + of_other[at - 3 : at + 3], atol=2 / FINE)
    assert np.abs(np.diff(100 + of_one[: at + 3])).max() < 1.5
    assert (of_one[: at - REACH // 2] == 0).all()
    assert (of_other[at + REACH // 2 :] == 0).all()


def test_what_is_no_light_is_not_taken_for_it() -> None:
    of_one, of_other = shifted(maps(30), maps(230))
    assert max(np.abs(of_one).max(), np.abs(of_other).max()) == MOST_SHIFT


@pytest.mark.parametrize(("coloured", "moved"), [(0.0, True), (1.0, True), (2.5, False)])
def test_tones_do_not_follow_a_thing_that_only_one_frame_has(coloured: float, moved: bool) -> None:
    of_one, _ = shifted(maps(100), maps(106, coloured))
    assert (abs(of_one[SEAM // 2 - 1]) > 1) == moved


def test_the_colours_of_a_palette_are_not_shifted() -> None:
    """They are temperatures: those of a frame beside it are the same without it."""
    rng = np.random.default_rng(1)
    counts = cv2.GaussianBlur(rng.normal(size=(480, 640)), (0, 0), 20)
    levels = np.interp(counts, [counts.min(), counts.max()], [0, 255]).astype(np.uint8)
    grey = look_for_seams(np.dstack([levels] * 3), (PLAIN, NO_BORDER))
    false = look_for_seams(np.asarray(cv2.applyColorMap(levels, cv2.COLORMAP_JET), np.uint8), (PLAIN, NO_BORDER))
    assert grey.tone is not None
    assert false.tone is None
    found = shifts(FIRST, WINDOW, lambda number: (FRAME, (maps(100), false)[number]), POOL)
    assert found.keys() == {0}
    assert not found[0][1].any()


def test_a_part_of_the_map_tells_the_same() -> None:
    part = WINDOW._replace(left=WINDOW.left + 2, right=WINDOW.right - 1)
    for whole, cut in zip(shifted(maps(100), maps(106)), shifted(maps(100), maps(106), part), strict=True):
        np.testing.assert_array_equal(whole[2 * SQUARES + REACH : 5 * SQUARES - REACH], cut[REACH:-REACH])


def test_what_shows_around_is_told_in_whole_numbers() -> None:
    shown = np.random.default_rng(1).random((64, 64)) < 0.5
    around = wide(shown)
    assert (around == np.rint(around)).all()
    np.testing.assert_array_equal(
        wide(shown[10:, 6:])[REACH // 2 :, REACH // 2 :], around[5 + REACH // 2 :, 3 + REACH // 2 :]
    )


def test_light_that_differs_leaves_no_step() -> None:
    camera = Camera(640, 480, focal=1.2)
    with TileCompositor(lambda name: None) as canvas:
        for order, value in enumerate((100, 106)):
            frame = painted(order, 320.0 + 300 * order, 240.0, camera=camera)
            canvas.paint(np.full((480, 640, 3), value, np.uint8), frame)
        row = np.hstack([sure(canvas.tile(0, Tile(16, (1 << 15) + x, 1 << 15))).colour for x in range(3)])[128, :, 0]
    assert np.abs(np.diff(row.astype(int))).max() <= 1
    assert (row[0], row[-1]) == (100, 106)
