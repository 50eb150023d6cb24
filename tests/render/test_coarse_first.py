"""Large frames are painted coarsely at first, and sharpened with the next ones or in a pause."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from painting_parts import SMALL, painted, picture

from gcs_mosaic.render import levels
from gcs_mosaic.render import repaint_queue as module
from gcs_mosaic.render.compositor import TileCompositor
from gcs_mosaic.render.levels import coarser_at_first
from gcs_mosaic.render.repaint_queue import BLURRED_PX, NEWER, PAUSE_S, SHARPENED_TOGETHER, PaintSettings, RepaintQueue
from gcs_mosaic.render.tile_grid import tiles_over
from gcs_mosaic.stitch.camera.geometry import Pose
from gcs_mosaic.stitch.graph.placement import Placement
from tests.factories import placement
from tests.sure import sure

STEP = 40.0  # canvas units between overlapping frames


class _Clock:
    """Stands where it is put."""

    now_s = 100.0

    def monotonic(self) -> float:
        return self.now_s


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> _Clock:
    clock = _Clock()
    monkeypatch.setattr(module, "time", clock)
    return clock


@pytest.fixture
def queue(monkeypatch: pytest.MonkeyPatch, clock: _Clock) -> Iterator[RepaintQueue]:
    """Whose frames are large: a level coarser they still have as many pixels as are painted at first."""
    monkeypatch.setattr(levels, "LARGE_PIXELS", SMALL.width * SMALL.height - 1)
    monkeypatch.setattr(levels, "FIRST_PIXELS", SMALL.width * SMALL.height // 4)
    queue = RepaintQueue(TileCompositor(lambda name: picture(int(name))), lambda painted: None, PaintSettings())
    yield queue
    queue.close()


def placed(number: int, x: float) -> Placement:
    return placement(str(number), Pose(x, 0.0), SMALL)


def paint(queue: RepaintQueue, number: int) -> Placement:
    one = placed(number, number * STEP)
    queue.paint_new(picture(number), picture(number)[::4, ::4], one, number)
    return one


def repaint(queue: RepaintQueue) -> None:
    while queue.repaint_some() is not None:
        pass


def levels_of(queue: RepaintQueue) -> list[int]:
    return [one.level for one in queue.painted()]


@pytest.mark.parametrize(
    ("width", "height", "coarser"), [(4000, 3000, 2), (2000, 1500, 1), (1920, 1080, 0), (8000, 6000, 3), (640, 480, 0)]
)
def test_a_frame_is_as_much_coarser_as_it_is_too_large(width: int, height: int, coarser: int) -> None:
    camera = replace(SMALL, width=width, height=height)
    frame = painted(0, camera=camera, level=15)
    assert coarser_at_first(frame) == replace(frame, level=15 - coarser)


def test_no_level_is_below_the_coarsest() -> None:
    frame = painted(0, camera=replace(SMALL, width=40_000, height=30_000), level=1)
    assert coarser_at_first(frame).level == 0


def test_new_frames_are_coarse_until_there_are_newer_ones(queue: RepaintQueue) -> None:
    for number in range(SHARPENED_TOGETHER + NEWER - 1):
        paint(queue, number)
    repaint(queue)
    coarse = levels_of(queue)
    assert len(set(coarse)) == 1
    assert not queue.has_repaints  # or the program would ask again and again
    paint(queue, len(coarse))
    repaint(queue)
    assert levels_of(queue) == [coarse[0] + 1] * SHARPENED_TOGETHER + [coarse[0]] * NEWER


def test_in_a_pause_all_are_sharpened(queue: RepaintQueue, clock: _Clock) -> None:
    paint(queue, 0)
    repaint(queue)
    (coarse,) = levels_of(queue)
    clock.now_s += PAUSE_S + 0.1
    assert queue.has_repaints
    repaint(queue)
    assert levels_of(queue) == [coarse + 1]
    assert not queue.has_repaints


@pytest.mark.parametrize(("off", "sharpened"), [(BLURRED_PX + 2, False), (BLURRED_PX - 2, True)])
def test_what_looks_worse_is_mended_first(queue: RepaintQueue, clock: _Clock, off: float, *, sharpened: bool) -> None:
    there = [paint(queue, number) for number in range(2)]
    repaint(queue)
    (coarse, _) = levels_of(queue)
    clock.now_s += PAUSE_S + 0.1
    queue.follow([replace(one, pose=replace(one.pose, x=one.pose.x + off)) for one in there])
    queue.repaint_some()  # looks how far they are
    queue.repaint_some()
    assert levels_of(queue) == [coarse + sharpened] * 2
    assert [one.pose.x for one in queue.painted()] == [off, STEP + off]


def test_a_coarse_frame_that_moves_stays_coarse(queue: RepaintQueue) -> None:
    there = paint(queue, 0)
    (coarse,) = levels_of(queue)
    queue.follow([replace(there, pose=replace(there.pose, x=30.0))])
    repaint(queue)
    assert levels_of(queue) == [coarse]
    assert queue.painted()[0].pose.x == 30.0


def test_the_final_map_has_every_frame_at_its_own_level(queue: RepaintQueue) -> None:
    there = [paint(queue, number) for number in range(3)]
    (coarse, *_) = levels_of(queue)
    for _ in queue.repaint_all(there):
        pass
    assert levels_of(queue) == [coarse + 1] * 3
    assert not queue.has_repaints


def test_the_map_ends_as_one_that_was_painted_sharply_at_once(
    queue: RepaintQueue, monkeypatch: pytest.MonkeyPatch
) -> None:
    there = [paint(queue, number) for number in range(3)]
    for _ in queue.repaint_all(there):
        pass
    monkeypatch.undo()
    other = RepaintQueue(TileCompositor(lambda name: picture(int(name))), lambda painted: None, PaintSettings())
    there = [paint(other, number) for number in range(3)]
    for _ in other.repaint_all(there):
        pass
    box = sure(other.canvas.extent(0)).box
    for tile in tiles_over(box, levels_of(other)[0]):
        one, two = queue.canvas.tile(0, tile), other.canvas.tile(0, tile)
        assert (one is None) == (two is None)
        if one is not None and two is not None:
            np.testing.assert_array_equal(one.colour, two.colour)
    other.close()


def test_a_frame_that_is_taken_away_waits_no_more(queue: RepaintQueue) -> None:
    paint(queue, 0)
    queue.take_away("0")
    repaint(queue)
    assert not queue.has_repaints
