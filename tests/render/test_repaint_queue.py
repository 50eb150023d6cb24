"""What is painted when: the most displaced first, and never so much at a time that a new frame would wait."""

from collections.abc import Iterable, Iterator
from contextlib import closing
from dataclasses import replace

import cv2
import numpy as np
import pytest
from painting_parts import SMALL, picture

from gcs_mosaic.render import repaint_queue as module
from gcs_mosaic.render.compositor import TileCompositor
from gcs_mosaic.render.displacement import displacement
from gcs_mosaic.render.light_field import at_places, nodes
from gcs_mosaic.render.render_list import RenderItem, TileKey
from gcs_mosaic.render.repaint_queue import CHECKED_AT_ONCE, PaintSettings, RepaintQueue
from gcs_mosaic.render.tile_grid import tiles_over
from gcs_mosaic.render.vignetting import FLAT
from gcs_mosaic.stitch.arrays import Bands
from gcs_mosaic.stitch.camera.dead_border import FRAMES, NO_BORDER
from gcs_mosaic.stitch.camera.geometry import Pose
from gcs_mosaic.stitch.features.extraction import Features
from gcs_mosaic.stitch.graph.placement import Placement
from tests.factories import placement
from tests.sure import sure

APART = 20_000.0  # canvas units, so that no two frames share a block of tiles


def placed(number: int, x: float, island: int = 0, gsd: float = 1.0) -> Placement:
    return placement(str(number), Pose(x, 0.0, log_gsd=float(np.log(gsd))), SMALL, island=island)


@pytest.fixture
def recorded() -> list[RenderItem]:
    return []


@pytest.fixture
def queue(recorded: list[RenderItem]) -> Iterator[RepaintQueue]:
    queue = RepaintQueue(TileCompositor(lambda name: picture(int(name))), recorded.append, PaintSettings())
    yield queue
    queue.close()


def paint(queue: RepaintQueue, placements: Iterable[Placement]) -> None:
    for order, one in enumerate(placements):
        queue.paint_new(picture(order), picture(order)[::4, ::4], one, order)


def repainted(queue: RepaintQueue) -> list[set[TileKey]]:
    """The sets of tiles that change, in turn."""
    changes = []
    while (changed := queue.repaint_some()) is not None:
        changes += [changed] if changed else []
    return changes


def test_the_most_displaced_frame_is_repainted_first(queue: RepaintQueue) -> None:
    there = [placed(k, k * APART) for k in range(4)]
    paint(queue, there)
    by = [3.0, 40.0, 0.5, 12.0]
    queue.follow(replace(p, pose=replace(p.pose, x=p.pose.x + off)) for p, off in zip(there, by, strict=True))
    finest = [max(change, key=lambda key: key[1].z)[1] for change in repainted(queue)]
    assert [round((tile.x * 256 - 2**23) / APART) for tile in finest] == [1, 3, 0]
    assert not queue.has_repaints


def test_a_frame_of_another_island_comes_before_all_others(queue: RepaintQueue) -> None:
    there = [placed(0, 0.0), placed(1, APART)]
    paint(queue, there)
    queue.follow([replace(there[0], pose=Pose(500.0, 0.0)), replace(there[1], island=1)])
    islands = [{island for island, _ in change} for change in repainted(queue)]
    assert islands == [{1}, {0}, {0}]  # where it lies, where it lay, and then the other


def test_frames_that_moved_back_are_left_alone(queue: RepaintQueue, recorded: list[RenderItem]) -> None:
    there = [placed(0, 0.0)]
    paint(queue, there)
    queue.follow([placed(0, 30.0)])
    queue.follow(there)
    assert queue.has_repaints
    assert repainted(queue) == []
    assert len(recorded) == 1


@pytest.mark.long
def test_no_call_looks_at_more_than_some_frames(queue: RepaintQueue, monkeypatch: pytest.MonkeyPatch) -> None:
    looked = 0

    def measure(painted: RenderItem, placement: Placement) -> float:
        nonlocal looked
        looked += 1
        return displacement(painted, placement)

    monkeypatch.setattr(module, "displacement", measure)
    there = [placed(k, 400.0 * k) for k in range(CHECKED_AT_ONCE + 20)]
    paint(queue, there)
    queue.follow(there)
    assert looked == 0
    queue.repaint_some()
    assert looked == CHECKED_AT_ONCE
    repainted(queue)
    assert looked == len(there)


def test_frames_of_different_kinds_lie_on_one_map_and_their_gains_apart(recorded: list[RenderItem]) -> None:
    """Every other frame from a thermal camera: each kind is shown by its own display, and agrees with its own kind."""

    def seen(name: str) -> Bands:
        light = picture(0).astype(float) * (1.0 if int(name) < 4 else 1.5)
        if int(name) % 2:
            return (light[..., :1] + 29_000).astype(np.uint16)
        return np.clip(light * 0.6, 0, 255).astype(np.uint8)

    with closing(RepaintQueue(TileCompositor(seen), recorded.append, PaintSettings())) as queue:
        names = [str(k) for k in range(6)]
        there = [replace(placed(k, 0.0), neighbours=tuple(names[:k])) for k in range(6)]
        for order, one in enumerate(there):
            queue.paint_new(seen(one.name), seen(one.name), one, order)
        list(queue.repaint_all(there))
    last = {painted.name: painted for painted in recorded}
    assert [len(last[name].gain) for name in names] == [3, 1, 3, 1, 3, 1]
    assert len({last[name].display.of_camera for name in names}) == 2
    for darker, brighter in (("0", "4"), ("1", "5")):
        before, after = [], []
        for name in (darker, brighter):
            display = last[name].display
            before.append(display.of_camera.levels(seen(name)).mean())
            light = np.exp(at_places(last[name].light, nodes())).mean()
            after.append(display.of_camera.levels(display.gained(seen(name), last[name].gain)).mean() * light)
        assert before[1] / before[0] > 1.4
        assert after[1] / after[0] == pytest.approx(1, abs=0.05)


def test_frames_of_about_one_height_are_painted_at_one_level(queue: RepaintQueue, recorded: list[RenderItem]) -> None:
    """Those of finer levels would hide the others, and whoever only those have seen."""
    flown = [placed(k, 40.0 * k, gsd=gsd) for k, gsd in enumerate((1.45, 1.7, 1.75, 1.75, 1.7, 1.3))]
    paint(queue, flown)
    assert [painted.level for painted in recorded] == [16, 15, 15, 15, 15, 16]
    for _ in queue.repaint_all(flown):
        pass
    assert {painted.name: painted.level for painted in recorded} == dict(zip("012345", [15] * 5 + [16], strict=True))


def seen_with_black_lines(number: int) -> np.ndarray:
    image = picture(number)
    image[:, -1:] = image[-1:] = 0
    return image


@pytest.fixture
def black_lined(recorded: list[RenderItem]) -> Iterator[RepaintQueue]:
    queue = RepaintQueue(
        TileCompositor(lambda name: seen_with_black_lines(int(name))), recorded.append, PaintSettings()
    )
    yield queue
    queue.close()


def paint_black_lined(queue: RepaintQueue, count: int) -> list[Placement]:
    there = [placed(k, k * 400.0) for k in range(count)]
    for order, one in enumerate(there):
        image = seen_with_black_lines(order)
        queue.paint_new(image, image[::4, ::4], one, order)
    return there


def test_a_dead_border_is_left_out_of_frames_painted_before_it_was_known(
    black_lined: RepaintQueue, recorded: list[RenderItem]
) -> None:
    paint_black_lined(black_lined, FRAMES + 1)
    border = recorded[-1].dead
    assert border.right >= 1 <= border.bottom
    assert (border.left, border.top) == (0, 0)
    assert [painted.dead for painted in recorded[: FRAMES - 1]] == [NO_BORDER] * (FRAMES - 1)
    assert black_lined.has_repaints
    repainted(black_lined)
    assert {painted.name: painted.dead for painted in recorded} == {str(k): border for k in range(FRAMES + 1)}
    extent = sure(black_lined.canvas.extent(0))
    shown = [black_lined.canvas.tile(0, tile) for tile in tiles_over(extent.box, extent.finest)]
    darkest = [int(tile.colour.max(axis=2)[tile.coverage > 0].min()) for tile in shown if tile is not None]
    assert min(darkest) > 40


def test_the_border_of_one_aircraft_s_camera_is_not_that_of_another_s(recorded: list[RenderItem]) -> None:
    """Frames of one size, of which those of the first aircraft alone have black lines, by turns."""

    def seen(name: str) -> np.ndarray:
        return seen_with_black_lines(int(name)) if int(name) % 2 == 0 else picture(int(name))

    with closing(RepaintQueue(TileCompositor(seen), recorded.append, PaintSettings())) as queue:
        for order in range(2 * FRAMES + 2):
            image, at = seen(str(order)), replace(placed(order, order * 400.0), aircraft=1 + order % 2)
            queue.paint_new(image, image[::4, ::4], at, order)
        repainted(queue)
        corner = np.array([(SMALL.width - 1, SMALL.height - 1)], np.float32)
        features = Features(corner, np.zeros((1, 128), np.uint8), SMALL.width, SMALL.height, 1.0)
        in_sight = [len(queue.in_sight(features, picture(0), aircraft)) for aircraft in (1, 2)]
    dead = {painted.name: painted.dead for painted in recorded}
    lined, other = ({dead[str(order)] for order in range(first, 2 * FRAMES + 2, 2)} for first in (0, 1))
    assert other == {NO_BORDER}
    assert {(border.right >= 1, border.bottom >= 1, border.left, border.top) for border in lined} == {
        (True, True, 0, 0)
    }
    assert in_sight == [0, 1]


def test_it_is_left_out_at_the_end_of_a_flight_without_pauses(
    black_lined: RepaintQueue, recorded: list[RenderItem]
) -> None:
    there = paint_black_lined(black_lined, FRAMES + 1)
    for _ in black_lined.repaint_all(there):
        pass
    assert {painted.name: painted.dead for painted in recorded} == {
        str(k): recorded[-1].dead for k in range(FRAMES + 1)
    }
    assert recorded[-1].dead != NO_BORDER
    assert not black_lined.has_repaints


def test_features_beside_a_dead_border_are_not_in_sight(black_lined: RepaintQueue) -> None:
    """The frame is painted at half the size at which its features are told."""
    width, height = 2 * SMALL.width, 2 * SMALL.height
    points = np.array([(30, 30), (30, height - 8), (width - 8, 30), (5, 30), (30, 5)], np.float32)
    features = Features(points, np.arange(5, dtype=np.uint8)[:, None], width, height, 2.0)
    image = seen_with_black_lines(0)
    assert len(black_lined.in_sight(features, image)) == 5
    paint_black_lined(black_lined, FRAMES)
    assert black_lined.in_sight(features, image).descriptors.ravel().tolist() == [0, 3, 4]


@pytest.mark.parametrize("pair", [(1, 2), (2, FRAMES + 1), (FRAMES, FRAMES + 1)])
def test_brightness_is_not_told_from_bars(recorded: list[RenderItem], pair: tuple[int, int]) -> None:
    """Two frames of one light, the bar of the later one on ground of the other; painted before or after it is known."""

    def barred(name: str) -> np.ndarray:
        image = np.random.default_rng(int(name)).integers(60, 160, picture(0).shape).astype(np.uint8)
        image[:24] = 12
        return image

    one, other = pair
    there = [placed(k, k * APART) for k in range(FRAMES + 2)]
    there[other] = replace(there[other], pose=Pose(one * APART, 40.0), neighbours=(str(one),))
    with closing(RepaintQueue(TileCompositor(barred), recorded.append, PaintSettings())) as queue:
        for order, at in enumerate(there):
            queue.paint_new(barred(at.name), barred(at.name), at, order)
        for _ in queue.repaint_all(there):
            pass
    last = {painted.name: painted for painted in recorded}
    assert {painted.dead for painted in last.values()} == {last["0"].dead}
    assert last["0"].dead.top >= 24
    assert last[str(other)].gain == pytest.approx((1, 1, 1), abs=0.1)


@pytest.mark.parametrize("palette", [None, cv2.COLORMAP_INFERNO])
def test_only_frames_in_false_colour_keep_their_tones(
    queue: RepaintQueue, recorded: list[RenderItem], palette: int | None
) -> None:
    """Two frames of one place, the second half as bright: those in false colour are painted as they came."""
    grey = np.random.default_rng(2).integers(0, 256, (*picture(0).shape[:2], 1))
    for number, brightness in enumerate([1.0, 0.5]):
        image = np.repeat((grey * brightness).astype(np.uint8), 3, axis=2)
        shown = image if palette is None else cv2.applyColorMap(image, palette)
        queue.paint_new(shown, shown[::4, ::4], replace(placed(number, 0.0), neighbours=("0",) * number), number)
    assert ((recorded[-1].gain, recorded[-1].vignetting) == ((1.0, 1.0, 1.0), FLAT)) == (palette is not None)
