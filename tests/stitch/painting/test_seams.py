from dataclasses import replace

import cv2
import numpy as np
import pytest
from painting_parts import painted

from gcs_mosaic.stitch.geometry import Camera
from gcs_mosaic.stitch.painting.blending import Part
from gcs_mosaic.stitch.painting.canvas import Canvas, CanvasSettings
from gcs_mosaic.stitch.painting.grid import Tile
from gcs_mosaic.stitch.painting.lattice import LATTICE
from gcs_mosaic.stitch.painting.layers import Layer, make_layer
from gcs_mosaic.stitch.painting.seams import DETAILED, FEATHER, MOST_SHIFT, look_for_seams, seam

ACROSS = np.linspace(0.9, 0.1, LATTICE, dtype=np.float32)[None].repeat(
    LATTICE, 0
)  # a weight that falls from left to right


def measured(
    thing: float = 0,
    near: float = 0,
    far: float = 0,
    log_detail: float = 1,
    tone: float = 100,
    beside: float = 0,
) -> np.ndarray:
    """thing: contrast of one that is brighter than all around; near, far: of anything that is; beside: of a thing that is
    near enough to colour the tone."""
    contrasts = [one for contrast in (thing, near, max(near, far)) for one in (contrast, *[0] * 5)]
    one = np.array([*contrasts, np.log2(1 + max(thing, beside) / 20), log_detail, tone, tone, tone], np.float16)
    return np.broadcast_to(one, (2 * LATTICE - 1, 2 * LATTICE - 1, len(one))).copy()


def layer(value: int, weight: np.ndarray | float, what: np.ndarray | None = None) -> Layer:
    weights = np.broadcast_to(np.float32(weight), (LATTICE, LATTICE)).copy()
    return make_layer(
        np.full((256, 256, 3), value, np.uint8), None, weights, None, measured() if what is None else what
    )


def part(one: Layer) -> Part:
    return Part(one.weight, one.measured, lambda: one)


def test_each_place_is_from_one_frame_but_for_a_few_pixels() -> None:
    row = seam(layer(200, ACROSS), part(layer(100, 1 - ACROSS))).colour[128, :, 0].astype(int)
    assert (np.diff(row) <= 0).all()
    assert row[0] == 200
    assert row[-1] == 100
    assert 1 <= ((row < 200) & (row > 100)).sum() <= 2 * FEATHER


def test_two_frames_that_see_equally_well_are_not_mixed() -> None:
    after = seam(layer(200, ACROSS), part(layer(100, ACROSS * 1.0001)))
    assert (after.colour == 100).all()


@pytest.mark.parametrize(("shown", "new", "value"), [(0, 90, 100), (90, 0, 200)])
def test_a_thing_counts_more_than_seeing_well(shown: int, new: int, value: int) -> None:
    here, there = measured(shown, shown), measured(new, new)
    weight = 0.9 if new == 0 else 0.01
    after = seam(layer(200, 1 - weight, here), part(layer(100, weight, there)))
    assert (after.colour == value).all()


@pytest.mark.parametrize("maybe", [measured(90, 90), measured(0, 90)])
def test_a_thing_that_both_may_have_does_not_decide(maybe: np.ndarray) -> None:
    assert (seam(layer(200, 0.9, maybe), part(layer(100, 0.3, measured(90, 90)))).colour == 200).all()


@pytest.mark.parametrize(("weight", "value"), [(0.4, 100), (0.1, 200)])
def test_a_thing_that_the_other_frame_has_elsewhere_decides_only_between_frames_about_as_good(
    weight: float, value: int
) -> None:
    shown, new = layer(200, 0.6, measured(far=90)), layer(100, weight, measured(90, 90))
    assert (seam(shown, part(new)).colour == value).all()


def test_a_thing_is_remembered_over_many_frames() -> None:
    shown = seam(layer(200, 0.9), part(layer(100, 0.2, measured(90, 90))))
    for _ in range(3):
        shown = seam(shown, part(layer(200, 0.9)))
    assert (shown.colour == 100).all()


def test_of_two_frames_the_sharper_one_is_taken() -> None:
    blurred = layer(200, 0.8, measured(log_detail=0.5))
    assert (seam(blurred, part(layer(100, 0.5, measured(log_detail=1.0)))).colour == 100).all()


def test_light_that_differs_leaves_no_step() -> None:
    shown, new = layer(100, ACROSS, measured(tone=100)), layer(105, 1 - ACROSS, measured(tone=105))
    after = seam(shown, part(new))
    row = after.colour[128, :, 0].astype(int)
    assert np.abs(np.diff(row)).max() <= 1
    assert (row[0], row[-1]) == (100, 105)
    np.testing.assert_allclose(
        after.measured[16, :, -1], np.interp(np.arange(2 * LATTICE - 1) * 8, np.arange(256), row), atol=1
    )


def test_what_is_no_light_is_not_taken_for_it() -> None:
    shown, new = layer(30, 0.5, measured(tone=30)), layer(230, 0.5001, measured(tone=230))
    assert seam(shown, part(new)).colour.min() >= 230 - MOST_SHIFT


@pytest.mark.parametrize(("beside", "shifted"), [(0, True), (10, True), (90, False)])
def test_tones_do_not_follow_a_thing_that_only_one_frame_has(beside: float, shifted: bool) -> None:
    shown, new = layer(100, 0.5, measured(tone=100)), layer(110, 0.5001, measured(tone=110, beside=beside))
    assert (seam(shown, part(new)).colour < 110).all() == shifted


def test_nothing_is_shifted_where_the_other_frame_has_no_weight() -> None:
    shown = layer(100, 0.0, measured(tone=100))
    assert (seam(shown, part(layer(108, 0.5, measured(tone=108)))).colour == 108).all()
    assert (seam(layer(100, 0.5, measured(tone=100)), part(layer(108, 0.0, measured(tone=108)))).colour == 100).all()


def test_a_tile_that_an_earlier_run_wrote_is_taken_for_plain_ground() -> None:
    earlier = replace(layer(100, 0.5), measured=None)
    assert (seam(earlier, part(layer(120, 0.3, measured(90, 90, tone=120)))).colour == 120).all()


def test_detail_is_greater_in_the_sharper_of_two_frames() -> None:
    sharp = np.random.default_rng(1).integers(60, 160, (400, 600, 3), dtype=np.uint8)
    blurred = cv2.GaussianBlur(sharp, (0, 0), 1.5)
    assert (look_for_seams(sharp)[..., DETAILED] > look_for_seams(blurred)[..., DETAILED] + 0.3).all()


def test_someone_who_walks_is_seen_whole_wherever_they_were() -> None:
    """Three frames of one place, each with a person of 9 px elsewhere, and the best one with nobody."""
    camera = Camera(640, 480, focal=1.2)
    rough = np.random.default_rng(2).normal(100, 4, (480, 640, 3))
    pictures = {"0.jpg": rough}
    for i, x in enumerate((150, 260, 420), 1):
        pictures[f"{i}.jpg"] = rough.copy()
        pictures[f"{i}.jpg"][300:309, x : x + 9] = (60, 60, 220)
    with Canvas(lambda name: None, CanvasSettings(interpolation="linear")) as canvas:
        for order, (name, picture) in enumerate(pictures.items()):
            frame = painted(order, 320.0, 240.0, camera=camera)
            assert frame.name == name
            canvas.paint(np.clip(picture, 0, 255).astype(np.uint8), frame)
        tiles = [canvas.tile(0, Tile(16, (1 << 15) + x, (1 << 15) + y)) for y in range(2) for x in range(3)]
    whole = np.vstack([np.hstack([t.colour for t in tiles[:3]]), np.hstack([t.colour for t in tiles[3:]])]).astype(int)
    assert people(whole) == 3


@pytest.mark.parametrize("way", [(40, 0), (-40, 0), (-20, 0), (28, -28)])
@pytest.mark.parametrize("apart", [60, 70, 80])
def test_someone_who_steps_over_a_seam_is_not_lost(way: tuple[int, int], apart: int) -> None:
    """Two frames side by side, the seam of which somebody has reached, passed or is about to pass."""
    camera = Camera(640, 480, focal=1.2)
    rough = np.random.default_rng(3).normal(100, 4, (600, 1000, 3))
    with Canvas(lambda name: None, CanvasSettings(interpolation="linear")) as canvas:
        for order, left in enumerate((0, 300)):
            ground = rough.copy()
            x, y = 470 - 60 + apart + order * way[0], 240 + order * way[1]
            ground[y : y + 9, x : x + 9] = (60, 60, 220)
            seen = np.clip(ground[:480, left : left + 640], 0, 255).astype(np.uint8)
            canvas.paint(seen, painted(order, left + 320.0, 240.0, camera=camera))
        tiles = [[canvas.tile(0, Tile(16, (1 << 15) + x, (1 << 15) + y)) for x in range(4)] for y in range(2)]
    assert people(np.vstack([np.hstack([tile.colour for tile in row]) for row in tiles])) >= 1


def people(picture: np.ndarray) -> int:
    """How many there are that are seen whole."""
    red = (picture[..., 2].astype(int) - picture[..., 1]) > 0.9 * 150
    _, _, stats, _ = cv2.connectedComponentsWithStats(red.astype(np.uint8))
    return int((stats[1:, cv2.CC_STAT_AREA] >= 7 * 7).sum())
