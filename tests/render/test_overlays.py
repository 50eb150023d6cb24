"""What an overlay covers is shown only where no other frame sees the place."""

from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest
from painting_parts import SMALL, painted, picture

from gcs_mosaic.render.blend_modes import MODES
from gcs_mosaic.render.compositor import CompositorSettings, TileCompositor
from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.render.repaint_queue import OVERLAY_DIFFERS, PaintSettings, RepaintQueue
from gcs_mosaic.render.tile_grid import tiles_over
from gcs_mosaic.stitch.arrays import Bands
from gcs_mosaic.stitch.camera.geometry import Pose
from gcs_mosaic.stitch.camera.still_mask import StillMask
from tests.factories import placement
from tests.sure import sure

BLOCKS = np.zeros((30, 40), bool)
BLOCKS[10:20, 12:28] = True
STILL = StillMask.of(BLOCKS)
WHITE = 40 * 64  # px of the overlay


def written_on(name: str) -> Bands:
    """Dark ground; the first frame has stripes in white where the overlay is."""
    image = np.full((SMALL.height, SMALL.width, 3), 60, np.uint8)
    if name == "0.jpg":
        image[40:80:2, 48:112] = 255
    return image


def white_in(*frames: RenderItem, blend: str = "seam") -> int:
    """Bright pixels that are shown."""
    with closing(TileCompositor(written_on, CompositorSettings(blend=blend))) as canvas:
        for frame in frames:
            canvas.paint(written_on(frame.name), frame)
        list(canvas.repaint())
        extent = sure(canvas.extent(0))
        shown = [canvas.tile(0, tile) for tile in tiles_over(extent.box, extent.finest)]
        return int(sum((tile.colour.max(axis=2) > 120).sum() for tile in shown if tile is not None))


def frames(still: StillMask | None) -> tuple[RenderItem, RenderItem]:
    """Two that see the place of the first one's overlay, which lies in its middle; an eighth of a width apart."""
    return painted(0, 100, 100, still=still), painted(1, 120, 100)


@pytest.mark.parametrize("blend", MODES)
def test_another_frame_that_sees_the_place_shows(blend: str) -> None:
    one, other = frames(STILL)
    assert white_in(one, other, blend=blend) == 0
    assert white_in(replace(other, order=0), replace(one, order=1), blend=blend) == 0


def test_not_knowing_of_it_the_sharpest_shows() -> None:
    assert white_in(*frames(None)) > WHITE / 4


def test_where_no_other_frame_sees_the_place_it_is_painted() -> None:
    one, _ = frames(STILL)
    assert white_in(one) > WHITE / 4


@pytest.fixture
def recorded() -> list[RenderItem]:
    return []


@pytest.fixture
def queue(recorded: list[RenderItem]) -> Iterator[RepaintQueue]:
    with closing(
        RepaintQueue(TileCompositor(lambda name: picture(int(name))), recorded.append, PaintSettings())
    ) as queue:
        yield queue


def fly(queue: RepaintQueue, *told: StillMask | None) -> None:
    for order, still in enumerate(told):
        one = placement(str(order), Pose(order * 400.0, 0.0), SMALL, still=still)
        queue.paint_new(picture(order), picture(order)[::4, ::4], one, order)


def test_frames_painted_before_it_was_known_are_painted_again(queue: RepaintQueue, recorded: list[RenderItem]) -> None:
    fly(queue, None, None, STILL, None)
    assert [one.still for one in recorded] == [None, None, STILL, STILL]
    assert queue.has_repaints
    while queue.repaint_some() is not None:
        pass
    assert {one.name: one.still for one in recorded} == {str(k): STILL for k in range(4)}


def test_at_the_end_all_are_painted_without_it(queue: RepaintQueue, recorded: list[RenderItem]) -> None:
    fly(queue, None, STILL)
    for _ in queue.repaint_all([]):
        pass
    assert {one.name: one.still for one in recorded} == {"0": STILL, "1": STILL}


def test_for_another_outline_nothing_is_painted_again(queue: RepaintQueue, recorded: list[RenderItem]) -> None:
    wider = BLOCKS.copy()
    wider[10:20, 28] = True
    assert StillMask.of(wider).differs(STILL) < OVERLAY_DIFFERS
    fly(queue, STILL, StillMask.of(wider))
    assert {one.still for one in recorded} == {STILL}
    assert not queue.has_repaints
