from dataclasses import replace

import cv2
import numpy as np
import pytest
from painting_parts import painted

from gcs_mosaic.render.blend_maps import BEYOND
from gcs_mosaic.render.cells import WHOLLY, Cells, Seen, lay_over, unknown
from gcs_mosaic.render.compositor import CompositorSettings, TileCompositor
from gcs_mosaic.render.display import PLAIN
from gcs_mosaic.render.frame_warp import frame_warp
from gcs_mosaic.render.light_field import COLUMNS, ROWS, STEPS, LightField
from gcs_mosaic.render.seams import CLIPPED, FAR, KEPT, LOOK, NEAR, THINGS, UNLIKE, decide, look_for_seams, see
from gcs_mosaic.render.tile_grid import Tile
from gcs_mosaic.stitch.camera.dead_border import NO_BORDER
from gcs_mosaic.stitch.camera.geometry import Camera
from tests.sure import sure

SHAPE = 4, 4
SHOWN, NEW = 1, 2


def seen(
    weight: float, thing: float = 0, near: float = 0, far: float = 0, log_detail: float = 1, clipped: float = 0
) -> Seen:
    """thing: contrast of one that is brighter than all around; near, far: of anything that is, twice the least to be noticed
    being 40; clipped: share of pixels."""
    planes = np.zeros((LOOK.stop, *SHAPE), np.uint8)
    for where, contrast in ((THINGS, thing), (NEAR, BEYOND * near), (FAR, BEYOND * max(near, far))):
        planes[where.start] = min(contrast, 255)
    planes[CLIPPED] = round(255 * clipped)
    score = np.full(SHAPE, np.log(weight) + 3 * log_detail, np.float32)
    return Seen(np.full(SHAPE, WHOLLY, np.uint8), score, planes)


def folded(*frames: Seen) -> Cells:
    cells = unknown(SHAPE, KEPT)
    for number, new in enumerate(frames, 1):
        cells, _ = lay_over(cells, new, number, decide(cells, new))
    return cells


def shown(*frames: Seen) -> int:
    """The number of the frame that shows, counted from 1."""
    (number,) = set(folded(*frames).first.ravel().tolist())
    return number


def test_the_frame_that_sees_better_shows() -> None:
    assert shown(seen(0.4), seen(0.5)) == NEW
    assert shown(seen(0.5), seen(0.4)) == SHOWN


@pytest.mark.parametrize(("of_shown", "of_new", "who"), [(0, 90, NEW), (90, 0, SHOWN)])
def test_a_thing_counts_more_than_seeing_well(of_shown: int, of_new: int, who: int) -> None:
    weight = 0.9 if of_new == 0 else 0.01
    assert shown(seen(1 - weight, of_shown, of_shown), seen(weight, of_new, of_new)) == who


@pytest.mark.parametrize("maybe", [90, 0])
def test_a_thing_that_both_may_have_does_not_decide(maybe: float) -> None:
    assert shown(seen(0.9, maybe, 90), seen(0.3, 90, 90)) == SHOWN


@pytest.mark.parametrize(("weight", "who"), [(0.4, NEW), (0.1, SHOWN)])
def test_a_thing_that_the_other_frame_has_elsewhere_decides_only_between_frames_about_as_good(
    weight: float, who: int
) -> None:
    assert shown(seen(0.6, far=90), seen(weight, 90, 90)) == who


def test_a_thing_is_remembered_over_many_frames() -> None:
    assert shown(seen(0.9), seen(0.2, 90, 90), seen(0.9), seen(0.95), seen(0.9)) == 2


def test_of_two_frames_the_sharper_one_is_taken() -> None:
    assert shown(seen(0.8, log_detail=0.5), seen(0.5, log_detail=1.0)) == NEW


@pytest.mark.parametrize("log_detail", [0.2, 3.0])
def test_where_all_are_blurred_alike_none_yields(log_detail: float) -> None:
    assert shown(seen(0.5, log_detail=log_detail), seen(0.4, log_detail=log_detail + 0.05)) == SHOWN


def test_clipped_light_yields_to_a_frame_that_has_it() -> None:
    assert shown(seen(1.0, clipped=1.0), seen(0.03)) == NEW
    assert shown(seen(0.03), seen(1.0, clipped=1.0)) == SHOWN
    assert shown(seen(0.5, clipped=1.0), seen(0.4, clipped=1.0)) == SHOWN
    assert shown(seen(0.5, clipped=0.02), seen(0.4)) == SHOWN


def test_a_clipped_thing_is_kept_where_the_other_has_none() -> None:
    """Someone in white who walks: each of two frames has them elsewhere, and neither may defer to the other."""
    assert shown(seen(0.6, 90, 90, clipped=1.0), seen(0.5, far=90)) == SHOWN
    assert shown(seen(0.6, far=90), seen(0.5, 90, 90, clipped=1.0)) == NEW


def test_the_next_best_is_remembered_too() -> None:
    cells = folded(seen(0.3), seen(0.5), seen(0.4), seen(0.2))
    assert (cells.first == 2).all()
    assert (cells.second == 3).all()
    np.testing.assert_allclose(cells.lead, np.log(0.5 / 0.4), atol=1e-6)


def test_detail_is_greater_in_the_sharper_of_two_frames() -> None:
    sharp = np.random.default_rng(1).integers(60, 160, (400, 600, 3), dtype=np.uint8)
    blurred = cv2.GaussianBlur(sharp, (0, 0), 1.5).astype(np.uint8)
    one, other = (sure(look_for_seams(picture, (PLAIN, NO_BORDER)).detail) for picture in (sharp, blurred))
    assert np.all(one > 1.3 * other)


def map_of(canvas: TileCompositor, columns: int) -> np.ndarray:
    """Two rows of tiles."""
    tiles = [[canvas.tile(0, Tile(16, (1 << 15) + x, (1 << 15) + y)) for x in range(columns)] for y in range(2)]
    return np.vstack([np.hstack([sure(tile).colour for tile in row]) for row in tiles])


def side_by_side(pictures: list[np.ndarray], apart: int) -> np.ndarray:
    """The map of frames of 640x480, each further to the right, without the outermost pixels."""
    camera = Camera(640, 480, focal=1.2)
    with TileCompositor(lambda name: None, CompositorSettings(interpolation="linear")) as canvas:
        for order, picture in enumerate(pictures):
            canvas.paint(picture, painted(order, 320.0 + apart * order, 240.0, camera=camera))
        width = apart * (len(pictures) - 1) + 640
        return map_of(canvas, -(-width // 256))[16:464, 16 : width - 16]


def score_in(brighter: float) -> float:
    """A frame's median score where its light is so much brighter than that of most frames, which its field takes out."""
    camera, ground = Camera(640, 480, focal=1.2), np.random.default_rng(6).normal(90, 6, (480, 640, 3))
    field = LightField(np.full((ROWS, COLUMNS, 3), -round(brighter * STEPS), np.int8).tobytes())
    frame = sure(frame_warp(replace(painted(0, 320.0, 240.0, camera=camera), light=field)))
    maps = look_for_seams(np.rint(ground * np.exp(brighter)).astype(np.uint8), (PLAIN, NO_BORDER))
    found = see(frame, maps, frame.window)
    return float(np.median(found.score[found.inside == WHOLLY]))


@pytest.mark.parametrize("brighter", [0.3, -0.3])
def test_a_frame_in_another_light_than_most_counts_less(brighter: float) -> None:
    assert score_in(0.0) - score_in(brighter) == pytest.approx(UNLIKE * 0.3, abs=0.15)


def test_a_sun_glint_is_shown_from_the_frame_that_has_it_elsewhere() -> None:
    """Glitter on water, blown over 130 px at the same place in each frame."""
    rng = np.random.default_rng(5)
    water, (y, x) = rng.normal(90, 3, (480, 840, 3)), np.mgrid[:480, :640]
    glow = 400 * np.exp(-((x - 320) ** 2 + (y - 240) ** 2) / 70**2)[..., None]
    pictures = []
    for left in (0, 200):
        glitter = water[:, left : left + 640] + glow * rng.uniform(0.9, 1.1, (480, 640, 1))
        pictures.append(np.clip(glitter, 0, 255).astype(np.uint8))
    taken, shown_of_it = (float((one.min(axis=2) >= 250).mean()) for one in (pictures[0], side_by_side(pictures, 200)))
    assert taken > 0.04
    assert shown_of_it < 0.02 * taken


def test_who_shines_in_the_dark_is_a_thing() -> None:
    night = np.zeros((480, 640, 3), np.uint8)
    night[200:209, 300:309] = 255
    assert look_planes(night)[THINGS].max() > 0


def test_who_is_dark_on_blown_snow_is_a_thing_and_its_rim_is_none() -> None:
    snow = np.full((480, 640, 3), 255, np.uint8)
    snow[:, :200] = 90
    assert look_planes(snow)[THINGS.start].max() == 0
    snow[200:209, 400:409] = (60, 60, 60)
    assert look_planes(snow)[THINGS][:, 45:60, 95:110].max() > 0


def look_planes(picture: np.ndarray) -> np.ndarray:
    """The planes of its look, (k, h, w)."""
    return np.moveaxis(np.dstack(look_for_seams(picture, (PLAIN, NO_BORDER)).planes), 2, 0)


def test_each_place_is_from_one_frame_but_for_a_few_pixels() -> None:
    camera = Camera(640, 480, focal=1.2)
    with TileCompositor(lambda name: None, CompositorSettings(interpolation="linear")) as canvas:
        for order, value in enumerate((60, 200)):
            canvas.paint(
                np.full((480, 640, 3), value, np.uint8), painted(order, 320.0 + 300 * order, 240.0, camera=camera)
            )
        row = map_of(canvas, 3)[200, :, 0].astype(int)
    assert (np.diff(row) >= 0).all()
    assert row[20] == 60
    assert row[-1] == 200
    steep = np.abs(np.diff(row)) > 2
    assert 4 <= steep.sum() <= 24


def test_someone_who_walks_is_seen_whole_wherever_they_were() -> None:
    """Three frames of one place, each with a person of 9 px elsewhere, and the best one with nobody."""
    camera = Camera(640, 480, focal=1.2)
    rough = np.random.default_rng(2).normal(100, 4, (480, 640, 3))
    pictures = {"0.jpg": rough}
    for i, x in enumerate((150, 260, 420), 1):
        pictures[f"{i}.jpg"] = rough.copy()
        pictures[f"{i}.jpg"][300:309, x : x + 9] = (60, 60, 220)
    with TileCompositor(lambda name: None, CompositorSettings(interpolation="linear")) as canvas:
        for order, (name, picture) in enumerate(pictures.items()):
            frame = painted(order, 320.0, 240.0, camera=camera)
            assert frame.name == name
            canvas.paint(np.clip(picture, 0, 255).astype(np.uint8), frame)
        whole = map_of(canvas, 3)
    assert people(whole) == 3


@pytest.mark.parametrize("way", [(40, 0), (-40, 0), (-20, 0), (28, -28)])
@pytest.mark.parametrize("apart", [60, 70, 80])
def test_someone_who_steps_over_a_seam_is_not_lost(way: tuple[int, int], apart: int) -> None:
    """Two frames side by side, the seam of which somebody has reached, passed or is about to pass."""
    camera = Camera(640, 480, focal=1.2)
    rough = np.random.default_rng(3).normal(100, 4, (600, 1000, 3))
    with TileCompositor(lambda name: None, CompositorSettings(interpolation="linear")) as canvas:
        for order, left in enumerate((0, 300)):
            ground = rough.copy()
            x, y = 470 - 60 + apart + order * way[0], 240 + order * way[1]
            ground[y : y + 9, x : x + 9] = (60, 60, 220)
            seen = np.clip(ground[:480, left : left + 640], 0, 255).astype(np.uint8)
            canvas.paint(seen, painted(order, left + 320.0, 240.0, camera=camera))
        whole = map_of(canvas, 4)
    assert people(whole) >= 1


def people(picture: np.ndarray) -> int:
    """How many there are that are seen whole."""
    red = (picture[..., 2].astype(int) - picture[..., 1]) > 0.9 * 150
    _, _, stats, _ = cv2.connectedComponentsWithStats(red.astype(np.uint8))
    return int((stats[1:, cv2.CC_STAT_AREA] >= 7 * 7).sum())
