"""Frames painted, moved and taken away in any order: what is shown in the end is what painting from scratch shows."""

from __future__ import annotations

from itertools import islice

import numpy as np
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, precondition, rule
from painting_parts import painted, picture

from gcs_mosaic.render.blend_modes import MODES
from gcs_mosaic.render.compositor import CompositorSettings, TileCompositor
from gcs_mosaic.render.pyramid import TilePicture
from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.render.tile_grid import Tile, tiles_over
from gcs_mosaic.stitch.arrays import Bands

names = st.integers(0, 4)
places = st.tuples(
    st.integers(-150, 150), st.integers(-100, 100), st.sampled_from([0.0, 0.7]), st.sampled_from([0, 0, 1])
)


def originals(name: str) -> Bands:
    return picture(int(name.removesuffix(".jpg")))


class CanvasMachine(RuleBasedStateMachine):
    def __init__(self) -> None:
        super().__init__()
        self.shown: dict[str, RenderItem] = {}

    @initialize(blend=st.sampled_from(sorted(MODES)))
    def begin(self, blend: str) -> None:
        self.settings = CompositorSettings(blend=blend, memory_mb=2)
        self.canvas = TileCompositor(originals, self.settings)

    @rule(order=names, place=places)
    def paint(self, order: int, place: tuple[int, int, float, int]) -> None:
        frame = laid(order, place)
        self.canvas.paint(originals(frame.name), frame)
        self.shown[frame.name] = frame

    @precondition(lambda self: self.shown)
    @rule(places=st.lists(places, min_size=1, max_size=3), data=st.data())
    def move(self, places: list[tuple[int, int, float, int]], data: st.DataObject) -> None:
        orders = data.draw(st.permutations([frame.order for frame in self.shown.values()]))
        frames = [laid(order, place) for order, place in zip(orders, places, strict=False)]
        self.canvas.move(frames)
        self.shown |= {frame.name: frame for frame in frames}

    @precondition(lambda self: self.shown)
    @rule(data=st.data())
    def take_away(self, data: st.DataObject) -> None:
        name = data.draw(st.sampled_from(sorted(self.shown)))
        self.canvas.remove([name])
        del self.shown[name]

    @rule(steps=st.integers(1, 3))
    def repaint_some(self, steps: int) -> None:
        for _ in islice(self.canvas.repaint(), steps):
            pass

    @rule(steps=st.integers(1, 4), undone=st.booleans())
    def go_on(self, steps: int, undone: bool) -> None:
        """Steps that leave off in the midst of tiles, the last of them undone as after an error."""
        for left in reversed(range(steps)):
            if self.canvas.behind:
                before = self.canvas.snapshot()
                self.canvas.repaint_step()
                if undone and not left:
                    self.canvas.restore(before)

    def teardown(self) -> None:
        if not hasattr(self, "canvas"):
            return
        with self.canvas, TileCompositor(originals, self.settings) as anew:
            for frame in sorted(self.shown.values(), key=lambda frame: frame.order):
                anew.paint(originals(frame.name), frame)
            tiles = [shown_on(canvas) for canvas in (self.canvas, anew)]
        assert tiles[0].keys() == tiles[1].keys()
        for key, tile in tiles[0].items():
            np.testing.assert_array_equal(tile.colour, tiles[1][key].colour)
            np.testing.assert_array_equal(tile.coverage, tiles[1][key].coverage)


def laid(order: int, place: tuple[int, int, float, int]) -> RenderItem:
    x, y, yaw, island = place
    return painted(order, x, y, yaw=yaw, island=island)


def shown_on(canvas: TileCompositor) -> dict[tuple[int, Tile], TilePicture]:
    """All tiles of both islands, once everything is painted."""
    list(canvas.repaint())
    assert canvas.behind == 0
    found = {}
    for island in (0, 1):
        box, coarsest, finest = canvas.extent(island) or ((0.0, 0.0, 0.0, 0.0), 1, 0)
        for level in range(coarsest, finest + 1):
            for tile in tiles_over(box, level):
                if (shown := canvas.tile(island, tile)) is not None:
                    found[island, tile] = shown
    return found


TestCanvas = CanvasMachine.TestCase
TestCanvas.settings = settings(max_examples=20, stateful_step_count=10)
