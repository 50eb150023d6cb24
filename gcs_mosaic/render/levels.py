"""Painting level of each frame: that of its island's other frames if its ground sampling distance is similar."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.render.tile_grid import level_among
from gcs_mosaic.render.warp_grid import resolved
from gcs_mosaic.stitch.transaction import Kept

# Share of an island's frames finer than the one its level is chosen for: a level finer than needed costs four times the pixels,
# and a flight begins with a climb.
FINER = 0.75
# A frame of more than the first (full HD has 2.1) is painted with at most the second of them at first: some more than an old
# screen has, a quarter of a second's work.
LARGE_PIXELS, FIRST_PIXELS = 2_500_000, 1_500_000


def coarser_at_first(painted: RenderItem) -> RenderItem:
    """A frame at the level at which a new one is painted: its own, or if it is large the finest at which it has no more than
    `FIRST_PIXELS`."""
    pixels = painted.camera.width * painted.camera.height
    coarser = math.ceil(math.log(pixels / FIRST_PIXELS, 4)) if pixels > LARGE_PIXELS else 0
    return replace(painted, level=max(0, painted.level - coarser))


class PaintingLevels(Kept):
    """Ground sampling distances of all frames that see ground."""

    def __init__(self) -> None:
        self._seen: dict[str, tuple[int, float]] = {}  # island and distance, by frame name

    def forget(self, name: str) -> None:
        """A frame that is painted no more."""
        self._seen.pop(name, None)

    def settled(self, painted: RenderItem) -> RenderItem:
        """The frame with its painting level, 0 if it sees no ground; a reference for others from now on."""
        gsd = resolved(painted.pose, painted.camera)
        if gsd is None:
            self._seen.pop(painted.name, None)
            return replace(painted, level=0)
        self._seen[painted.name] = painted.island, gsd
        beside = [other for island, other in self._seen.values() if island == painted.island]
        return replace(painted, level=level_among(gsd, float(np.quantile(beside, FINER))))
