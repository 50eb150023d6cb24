"""The level each frame is painted at: that of its island's other frames, if it sees the ground about as finely as they do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gcs_mosaic.render.painted import Painted
from gcs_mosaic.render.tile_grid import level_among
from gcs_mosaic.render.warp_grid import resolved
from gcs_mosaic.stitch.transaction import Kept

# The share of an island's frames that see the ground more finely than the one its level suits: a level finer than needed
# costs four times the pixels, and a flight begins with a climb.
FINER = 0.75


class PaintingLevels(Kept):
    """The ground sampling distances of all frames that see any ground."""

    def __init__(self) -> None:
        self._seen: dict[str, tuple[int, float]] = {}  # island and distance, by the frame's name

    def settled(self, painted: Painted) -> Painted:
        """The frame at the level where it is to be painted, 0 if it sees no ground; it counts for the others from now on."""
        gsd = resolved(painted.pose, painted.camera)
        if gsd is None:
            self._seen.pop(painted.name, None)
            return replace(painted, level=0)
        self._seen[painted.name] = painted.island, gsd
        beside = [other for island, other in self._seen.values() if island == painted.island]
        return replace(painted, level=level_among(gsd, float(np.quantile(beside, FINER))))
