import random
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest
from painting_parts import hilly, painted, picture

from gcs_mosaic.render import compositor, territory
from gcs_mosaic.render.blend_maps import BlendMaps
from gcs_mosaic.render.blend_modes import MODES
from gcs_mosaic.render.compositor import CompositorSettings, TileCompositor
from gcs_mosaic.render.display import Display
from gcs_mosaic.render.frame_warp import FrameWarp, frame_warp
from gcs_mosaic.render.light_field import COLUMNS, ROWS, LightField
from gcs_mosaic.render.pixels import FramePicture
from gcs_mosaic.render.pyramid import TilePicture
from gcs_mosaic.render.render_list import RenderItem, TileKey
from gcs_mosaic.render.tile_grid import Tile, tiles_over
from gcs_mosaic.render.vignetting import FLAT
from gcs_mosaic.stitch.arrays import Bands
from gcs_mosaic.stitch.camera.dead_border import NO_BORDER, DeadBorder
from gcs_mosaic.stitch.camera.geometry import Camera
from tests.sure import sure
from tests.tiers import thorough

MIDDLE = 1 << 15
Canvases = Callable[..., TileCompositor]  # makes one by its settings


def originals(name: str) -> Bands:
    return picture(int(name.removesuffix(".jpg")))


def noted(names: list[str]) -> Callable[[str], Bands]:
    """The originals, and in `names` which of them were asked for."""

    def load(name: str) -> Bands:
        names.append(name)
        return originals(name)

    return load


@pytest.fixture
def canvas() -> Iterator[Canvases]:
    """Makes canvases, and closes them in the end."""
    with ExitStack() as stack:
        yield lambda load=originals, load_tile=None, **settings: stack.enter_context(
            TileCompositor(load, CompositorSettings(**settings), load_tile=load_tile)
        )


def paint(c: TileCompositor, *frames: RenderItem) -> set[TileKey]:
    nothing: set[TileKey] = set()
    return nothing.union(*(c.paint(originals(frame.name), frame) for frame in frames))


def random_frame(rng: random.Random, order: int) -> RenderItem:
    x, y, gsd = rng.uniform(-400, 400), rng.uniform(-300, 300), rng.choice([1.0, 1.0, 2.2, 5.0])
    gain = rng.choice([(1.0, 1.0, 1.0), (1.1, 0.95, 1.3)])
    relief = rng.choice([None, hilly(rng.randrange(9))])
    vignetting = rng.choice([FLAT, ((0.1, -0.3, 0.05), (0.0, -0.2, 0.0), (0.0, -0.4, 0.1))])
    steps = np.random.default_rng(rng.randrange(9)).integers(-60, 60, (ROWS, COLUMNS, 3), np.int8)
    light = rng.choice([None, LightField(steps.tobytes())])
    yaw, pitch = rng.uniform(-3, 3), rng.uniform(-0.3, 0.3)
    dead = rng.choice([NO_BORDER, DeadBorder(0, 12, 1, 3)])
    looks: dict[str, Any] = {"gain": gain, "vignetting": vignetting, "relief": relief, "dead": dead, "light": light}
    return painted(order, x, y, gsd=gsd, yaw=yaw, pitch=pitch, **looks)


def all_tiles(c: TileCompositor) -> dict[Tile, TilePicture]:
    box, coarsest, finest = sure(c.extent(0))
    tiles = (tile for level in range(coarsest - 2, finest + 2) for tile in tiles_over(box, level))
    return {tile: shown for tile in tiles if (shown := c.tile(0, tile)) is not None}


def middle_of(c: TileCompositor) -> TilePicture:
    return sure(c.tile(0, Tile(16, MIDDLE, MIDDLE)))


def assert_same(one: dict[Tile, TilePicture], other: dict[Tile, TilePicture]) -> None:
    assert one.keys() == other.keys()
    for tile, shown in one.items():
        np.testing.assert_array_equal(shown.colour, other[tile].colour)
        np.testing.assert_array_equal(shown.coverage, other[tile].coverage)


@pytest.mark.long
@pytest.mark.parametrize("seed", [0, thorough(1), thorough(2)])
@pytest.mark.parametrize("blend", MODES)
def test_whatever_the_way_the_tiles_are_those_of_a_rebuild(canvas: Canvases, blend: str, seed: int) -> None:
    rng = random.Random(seed)
    step_by_step = canvas(blend=blend, memory_mb=2)
    final: dict[str, RenderItem] = {}
    for _ in range(20):
        frame, action = random_frame(rng, rng.randrange(12)), rng.random()
        if action < 0.6 or frame.name not in final:
            paint(step_by_step, frame)
            final[frame.name] = frame
        elif action < 0.85:
            step_by_step.move([frame])
            final[frame.name] = frame
        else:
            step_by_step.remove([frame.name])
            del final[frame.name]
        for _, _ in zip(range(rng.randrange(4)), step_by_step.repaint(), strict=False):
            pass
    list(step_by_step.repaint())
    rebuilt = canvas(blend=blend)
    paint(rebuilt, *sorted(final.values(), key=lambda frame: frame.order))
    list(rebuilt.repaint())
    assert (step_by_step.behind, rebuilt.behind) == (0, 0)
    assert_same(all_tiles(step_by_step), all_tiles(rebuilt))


def test_frames_painted_in_order_need_no_repaint(canvas: Canvases) -> None:
    c = canvas()
    paint(c, *(painted(i, 30.0 * i, 10.0 * i) for i in range(6)))
    assert c.behind == 0


def test_paint_tells_of_every_tile_that_changed(canvas: Canvases) -> None:
    c, rng = canvas(), random.Random(5)
    paint(c, random_frame(rng, 0))
    for order in range(1, 8):
        before = all_tiles(c)
        told = paint(c, random_frame(rng, order))
        for tile, after in all_tiles(c).items():
            assert (0, tile) in told or np.array_equal(after.colour, before[tile].colour)


def test_a_late_frame_is_shown_at_once_and_set_right_by_a_repaint(canvas: Canvases) -> None:
    c = canvas(blend="newest")
    paint(c, painted(2, 100, 100))
    newest = middle_of(c).colour
    paint(c, painted(1, 100, 100))
    assert not np.array_equal(middle_of(c).colour, newest)
    assert c.behind == 1
    list(c.repaint())
    np.testing.assert_array_equal(middle_of(c).colour, newest)


def test_no_half_made_tile_is_shown_while_repainting(canvas: Canvases) -> None:
    c = canvas()
    paint(c, *(painted(i, 100 + 5.0 * i, 100) for i in range(5)))
    before = all_tiles(c)
    c.move([painted(0, 90, 100)])
    shown = Tile(16, MIDDLE, MIDDLE)
    for told in c.repaint():
        if told:
            break
        assert_same(all_tiles(c), before)
    assert (0, shown) in told
    assert not np.array_equal(middle_of(c).colour, before[Tile(16, MIDDLE, MIDDLE)].colour)


@pytest.mark.parametrize("way", [(16, 15), (15, 16)])
@pytest.mark.parametrize("first", [0, 1])
def test_what_goes_to_another_level_is_shown_all_the_time(canvas: Canvases, way: tuple[int, int], first: int) -> None:
    """Whichever of two frames on the same tiles is the more urgent one, and whichever level is made anew first."""
    c, (before, after) = canvas(), way
    paint(c, painted(0, 128, 128, level=before), painted(1, 180, 128, level=before))
    c.move([painted(first, 128 + 52 * first, 129, level=after)], urgency=1.0)
    c.move([painted(1 - first, 180 - 52 * first, 127, level=before)], urgency=2.0)
    for _ in c.repaint(block=1):
        fine, coarse = c.tile(0, Tile(16, MIDDLE, MIDDLE)), c.tile(0, Tile(15, MIDDLE // 2, MIDDLE // 2))
        seen = fine is not None and (fine.coverage[128, 64:240] > 0).all()
        assert seen or (coarse is not None and (coarse.coverage[64, 32:120] > 0).all())
    assert c.behind == 0


def test_two_frames_that_change_levels_do_not_wait_for_each_other(canvas: Canvases) -> None:
    c = canvas()
    paint(c, painted(0, 128, 128, level=16), painted(1, 128, 128, level=15))
    c.move([painted(0, 128, 128, level=15), painted(1, 128, 128, level=16)])
    list(c.repaint())
    assert c.behind == 0


def test_what_moves_while_its_tile_is_repainted_is_not_lost(canvas: Canvases) -> None:
    c, rebuilt = canvas(), canvas()
    paint(c, *(painted(i, 100 + 5.0 * i, 100) for i in range(4)))
    c.move([painted(2, 140, 100)])
    steps = c.repaint()
    for _ in range(2):
        next(steps)
    c.move([painted(0, 90, 90)])
    paint(c, painted(4, 80, 100))
    list(steps)
    paint(
        rebuilt,
        painted(0, 90, 90),
        painted(1, 105, 100),
        painted(2, 140, 100),
        painted(3, 115, 100),
        painted(4, 80, 100),
    )
    assert_same(all_tiles(c), all_tiles(rebuilt))


@pytest.mark.parametrize("undone_after", range(1, 7))
def test_a_step_that_was_undone_is_not_done_twice(canvas: Canvases, undone_after: int) -> None:
    """Cells are decided again in place, which no snapshot brings back."""
    frames, c, rebuilt = [painted(i, 100 + 60.0 * i, 100 + 9.0 * i) for i in range(4)], canvas(), canvas()
    paint(rebuilt, *frames)
    c.move(frames)
    for _ in range(undone_after - 1):
        c.repaint_step()
    before = c.snapshot()
    c.repaint_step()
    c.restore(before)
    list(c.repaint())
    assert_same(all_tiles(c), all_tiles(rebuilt))


@pytest.mark.parametrize("side", [1, 2])
def test_cells_decided_block_by_block_are_those_decided_together(
    canvas: Canvases, monkeypatch: pytest.MonkeyPatch, side: int
) -> None:
    frames, c, whole = [painted(i, 100 + 130.0 * i, 100 + 70.0 * i, yaw=0.3 * i) for i in range(4)], canvas(), canvas()
    paint(whole, *frames)
    monkeypatch.setattr(compositor, "FOLDED", side)
    monkeypatch.setattr(territory, "SETTLED", side)
    c.move(frames)
    list(c.repaint())
    assert_same(all_tiles(c), all_tiles(whole))


def test_a_repaint_decodes_each_original_once(canvas: Canvases) -> None:
    asked: list[str] = []
    c = canvas(noted(asked))
    frames = [painted(i, 100 + 40.0 * i, 100) for i in range(9)]
    paint(c, *frames)
    assert c.move(frames) == 0
    c._frame_cache.clear()
    asked.clear()
    c.move([painted(i, 100 + 40.0 * i, 110) for i in range(9)])
    list(c.repaint())
    assert sorted(asked) == [frame.name for frame in frames]


@pytest.mark.parametrize("column", range(5))
def test_a_level_that_fits_into_one_block_is_painted_together_whatever_waits_on_others(
    canvas: Canvases, column: int
) -> None:
    """Tiles of a coarser level have smaller numbers: blocks of a finer one are not counted from these."""
    c, block = canvas(originals), 5
    fine = [painted(i, 256.0 * column + 500.0 * i, 300.0, level=16) for i in range(2)]
    c.move([painted(2, 9000.0, 300.0, gsd=4.0, level=14)])
    c.move(fine, urgency=1.0)
    there = {key for key in c._behind if key[1].z == 16}
    columns = {key[1].x for key in there}
    assert 3 <= max(columns) - min(columns) < block
    assert c._next_block(block) == there


def test_only_tiles_that_are_to_look_otherwise_are_made_anew(canvas: Canvases) -> None:
    """A frame in the midst of others moves a little; where it is far from showing, nothing happens."""
    wide = Camera(900, 700, focal=1.2)
    c = canvas(lambda name: picture(int(name.removesuffix(".jpg")), wide), blend="first")
    for frame in (painted(0, 100, 100, camera=wide), painted(1, 600, 100, camera=wide)):
        c.paint(picture(frame.order, wide), frame)
    c.move([painted(1, 601, 100, camera=wide)])
    waiting = c.behind
    told = {key for changed in c.repaint() for key in changed if key[1].z == 16}
    assert 0 < len(told) < waiting


def test_a_neighbour_whose_original_cannot_be_had_does_not_hold_a_new_frame_back(canvas: Canvases) -> None:
    def load(name: str) -> None:
        raise OSError(name)

    for missing in (load, lambda name: None):
        c = canvas(missing)
        paint(c, painted(0, 100, 100))
        before = middle_of(c).colour
        c._frame_cache.clear()
        paint(c, painted(1, 130, 100))
        assert not np.array_equal(middle_of(c).colour, before)
        assert c.behind > 0


def test_what_is_removed_vanishes_from_all_levels(canvas: Canvases) -> None:
    c = canvas()
    told = paint(c, painted(0, 100, 100))
    c.remove(["0.jpg"])
    vanished: set[TileKey] = set()
    assert told <= vanished.union(*c.repaint())
    assert all(c.tile(*key) is None for key in told)
    assert c.extent(0) is None


def test_an_original_that_is_gone_leaves_its_tiles_as_they_are(canvas: Canvases) -> None:
    c = canvas(lambda name: None if name == "0.jpg" else originals(name))
    paint(c, painted(0, 100, 100), painted(1, 110, 100))
    before = all_tiles(c)
    c._frame_cache.clear()
    c.move([painted(1, 115, 100)])
    list(c.repaint())
    assert (c.behind, c.gone) == (0, {"0.jpg"})
    assert_same(all_tiles(c), before)


def test_a_flight_goes_on_from_tiles_on_disk_and_ends_up_the_same(canvas: Canvases) -> None:
    rng = random.Random(8)
    frames = [random_frame(rng, order) for order in range(6)]
    whole, earlier = canvas(), canvas()
    paint(whole, *frames)
    list(whole.repaint())
    paint(earlier, *frames[:5])
    resumed = canvas(load_tile=earlier.tile)
    resumed.resume(frames[:5])
    shown = all_tiles(earlier)
    assert all(resumed.tile(0, tile) is not None for tile in shown)
    paint(resumed, frames[5])
    assert resumed.behind > 0
    list(resumed.repaint())
    assert_same(all_tiles(resumed), all_tiles(whole))


def test_an_island_that_has_shrunk_while_it_goes_on_leaves_no_overviews_behind(canvas: Canvases) -> None:
    near, far = painted(0, 100, 100), painted(1, 6000, 100)
    earlier = canvas()
    written = {key[1].z for key in paint(earlier, near, far)}
    top = sure(earlier.extent(0)).coarsest
    assert min(written) == top
    resumed = canvas(load_tile=earlier.tile)
    there = {key for key in resumed.resume([near, far]) if key[1].z >= top}
    resumed.move([replace(far, pose=replace(far.pose, x=130.0))])
    told = set[TileKey]().union(*resumed.repaint())
    gone = {key for key in there if key[1].z < sure(resumed.extent(0)).coarsest}
    assert gone
    assert gone <= told
    assert all(resumed.tile(*key) is None for key in gone)


def test_islands_do_not_touch_each_other(canvas: Canvases) -> None:
    c = canvas()
    paint(c, painted(0, 100, 100))
    before = all_tiles(c)
    assert {island for island, _ in paint(c, painted(1, 100, 100, island=1))} == {1}
    assert_same(all_tiles(c), before)


def test_a_frame_that_sees_no_ground_paints_nothing(canvas: Canvases) -> None:
    c = canvas()
    assert paint(c, painted(0, roll=3.1, level=16)) == set()
    assert c.extent(0) is None


def test_an_image_of_another_size_is_refused_and_changes_nothing(canvas: Canvases) -> None:
    c = canvas()
    with pytest.raises(ValueError, match=r"0\.jpg is \(100, 160, 3\)"):
        c.paint(originals("0.jpg")[:100], painted(0))
    assert c.extent(0) is None


def test_an_unknown_blend_is_refused_with_the_known_ones() -> None:
    with pytest.raises(ValueError, match="'egde' is not one of seam, edge, newest, first"):
        CompositorSettings(blend="egde")


def test_a_uniform_scene_stays_uniform_across_frames_tiles_and_levels(canvas: Canvases) -> None:
    c = canvas()
    for i in range(8):
        c.paint(np.full((120, 160, 3), 90, np.uint8), painted(i, 60.0 * i, 25.0 * i, gsd=1 + 0.4 * i, yaw=i))
    for shown in all_tiles(c).values():
        assert set(np.unique(shown.colour[shown.coverage > 0])) == {90}


@pytest.mark.parametrize("interpolation", ["linear", "cubic"])
@pytest.mark.parametrize("yaw", [0.0, 0.4])
def test_nothing_of_a_dead_border_is_painted_nor_mixed_into_what_is(
    canvas: Canvases, interpolation: str, yaw: float
) -> None:
    dead = DeadBorder(2, 11, 1, 5)

    def shown(value: int) -> dict[Tile, TilePicture]:
        def load(name: str) -> np.ndarray:
            image = np.full_like(originals(name), value)
            inner = slice(dead.top, -dead.bottom), slice(dead.left, -dead.right)
            image[inner] = originals(name)[inner]
            return image

        c = canvas(load, interpolation=interpolation)
        frame = painted(0, 100, 100, yaw=yaw, dead=dead)
        c.paint(load(frame.name), frame)
        return all_tiles(c)

    black, white = shown(0), shown(255)
    assert_same(black, white)
    seen = sum((picture.coverage > 0).sum() for tile, picture in black.items() if tile.z == 16)
    assert seen == pytest.approx((160 - 3) * (120 - 16), rel=0.03)


def test_a_dead_border_leaves_the_rest_of_a_frame_where_it_was(canvas: Canvases) -> None:
    whole, part = canvas(), canvas()
    paint(whole, painted(0, 100, 100, yaw=0.3))
    paint(part, painted(0, 100, 100, yaw=0.3, dead=DeadBorder(right=9)))
    before, after = all_tiles(whole), all_tiles(part)
    for tile, picture_of_part in after.items():
        inside = cv2.erode(picture_of_part.coverage, np.ones((9, 9), np.uint8)) == 255
        np.testing.assert_array_equal(picture_of_part.colour[inside], before[tile].colour[inside])


@pytest.mark.parametrize("way", ["hastily", "seen"])
def test_what_was_painted_in_haste_or_only_seen_ends_up_the_same(canvas: Canvases, way: str) -> None:
    rng = random.Random(9)
    frames = [random_frame(rng, order) for order in range(8)]
    whole, other = canvas(), canvas()
    paint(whole, *frames)
    for frame in frames:
        other._frame_cache.clear()
        if way == "hastily":
            assert other.paint(originals(frame.name), frame, hastily=True)
        else:
            other.look(originals(frame.name), frame)
            other.move([frame])
    assert other.behind > 0
    list(other.repaint())
    assert_same(all_tiles(other), all_tiles(whole))


def test_a_look_that_raises_is_left_to_the_next_one_at_that_frame(
    canvas: Canvases, monkeypatch: pytest.MonkeyPatch
) -> None:
    frames, c, whole = [painted(order, 100 + 40 * order, 100) for order in range(4)], canvas(), canvas()
    paint(whole, *frames)
    looked, failing = c._frame_cache._looked, {"0.jpg"}

    def look(one: RenderItem, picture: FramePicture) -> BlendMaps:
        if one.name in failing:
            failing.remove(one.name)
            raise MemoryError("no room to look")
        return looked(one, picture)

    monkeypatch.setattr(c._frame_cache, "_looked", look)
    for frame in frames:
        c.look(originals(frame.name), frame)
        c.move([frame])
    list(c.repaint())
    assert not failing
    assert_same(all_tiles(c), all_tiles(whole))


@pytest.mark.parametrize("other", ["nothing", "another frame", "another border", "an image that does not fit"])
def test_a_look_begun_while_the_place_is_sought_is_used_if_it_is_of_that_frame_as_it_is_painted(
    canvas: Canvases, monkeypatch: pytest.MonkeyPatch, other: str
) -> None:
    frames, c, whole = [painted(order, 100 + 40 * order, 100) for order in range(4)], canvas(), canvas()
    paint(whole, *frames)
    looked = c._frame_cache._looked
    looks: list[str] = []

    def look(one: RenderItem, picture: FramePicture) -> BlendMaps:
        looks.append(one.name)
        return looked(one, picture)

    monkeypatch.setattr(c._frame_cache, "_looked", look)
    for frame in frames:
        image = originals(frame.name)
        name = "99.jpg" if other == "another frame" else frame.name
        dead = DeadBorder(0, 5, 0, 0) if other == "another border" else frame.dead
        c.begin_look(name, image[..., :2] if other == "an image that does not fit" else image, frame.display, dead)
        c.paint(image, frame)
    assert looks == ([] if other == "nothing" else [frame.name for frame in frames])
    assert_same(all_tiles(c), all_tiles(whole))


@pytest.mark.long
def test_places_that_were_expected_are_those_that_are_used(canvas: Canvases, monkeypatch: pytest.MonkeyPatch) -> None:
    frames, c, whole = [painted(order, 100 + 40 * order, 100) for order in range(12)], canvas(), canvas()
    paint(whole, *frames)
    paint(c, *[painted(order, 90 + 40 * order, 100) for order in range(12)])
    worked_out: Counter[str] = Counter()

    def place(one: RenderItem, before: FrameWarp | None) -> FrameWarp | None:
        worked_out[one.name] += 1
        return frame_warp(one, before)

    monkeypatch.setattr("gcs_mosaic.render.frame_cache.frame_warp", place)
    for some in (frames[:5], frames[5:]):
        c.expect(some)
        for frame in some:
            c.move([frame])
    assert worked_out == Counter(frame.name for frame in frames)  # none twice
    list(c.repaint())
    assert worked_out == Counter(frame.name for frame in frames)
    assert_same(all_tiles(c), all_tiles(whole))


def test_what_a_frame_contributes_to_the_cells_is_computed_once(
    canvas: Canvases, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[str] = []
    seam = MODES["seam"]

    def see(frame: FrameWarp, *rest: Any) -> Any:
        seen.append(frame.painted.name)
        return seam.see(frame, *rest)

    monkeypatch.setitem(MODES, "seam", replace(seam, see=see))
    c = canvas()
    frames = [painted(order, 60 * order, 0) for order in range(4)]
    for frame in frames:
        c.look(originals(frame.name), frame)
    c.move(frames)
    for _ in c.repaint():
        pass
    assert sorted(seen) == [frame.name for frame in frames]


def test_a_frame_that_cannot_be_looked_at_ahead_costs_no_other_one(
    canvas: Canvases, monkeypatch: pytest.MonkeyPatch
) -> None:
    frames, c, whole = [painted(order, 100 + 40 * order, 100) for order in range(4)], canvas(), canvas()
    paint(whole, *frames)
    paint(c, *[painted(order, 90 + 40 * order, 100) for order in range(4)])
    c.move(frames)
    known = c._frame_cache.warp
    raised: list[str] = []

    def placing(one: RenderItem) -> FrameWarp | None:
        if one.name == "2.jpg" and not raised:
            raised.append(one.name)
            raise MemoryError("no room to place it")
        return known(one)

    monkeypatch.setattr(c._frame_cache, "warp", placing)
    list(c.repaint())  # the step of the frame before goes on
    assert raised
    assert_same(all_tiles(c), all_tiles(whole))


def test_a_dark_map_that_is_shown_lighter_is_the_same_map(canvas: Canvases) -> None:
    frames = [painted(order, 100 + 60 * order, 100) for order in range(4)]
    plain, lighter = canvas(), canvas()
    paint(plain, *frames)
    paint(lighter, *[replace(frame, display=Display(factor=1.2, gamma=0.6)) for frame in frames])
    here, there = all_tiles(plain), all_tiles(lighter)
    assert here.keys() == there.keys()
    apart = [cv2.absdiff(Display(factor=1.2, gamma=0.6).lightened(here[key].colour), there[key].colour) for key in here]
    assert np.mean([one.mean() for one in apart]) < 0.2  # but where two frames are mixed, or pixels are


def test_a_frame_painted_in_haste_is_shown_where_it_is_to_be(canvas: Canvases) -> None:
    asked: list[str] = []
    c = canvas(noted(asked))
    paint(c, painted(0, 100, 100))
    c._frame_cache.clear()
    second = painted(1, 150, 100)
    c.paint(originals(second.name), second, hastily=True)
    assert asked == []
    here = middle_of(c).colour
    list(c.repaint())
    apart = cv2.absdiff(here, middle_of(c).colour)
    assert (apart.max(axis=2) > 13).mean() < 0.01  # but for tones
