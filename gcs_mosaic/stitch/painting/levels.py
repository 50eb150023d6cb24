"""The level each frame is painted at: that of its island's other frames, if it sees the ground about as finely as they do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gcs_mosaic.stitch.painting.grid import level_among
from gcs_mosaic.stitch.painting.lattice import resolved
from gcs_mosaic.stitch.painting.painted import Painted

# The share of an island's frames that see the ground more finely than the one its level suits: a level finer than needed
# costs four times the pixels, and a flight begins with a climb.
FINER = 0.75


class PaintingLevels:
    """The ground sampling distances of all frames, by island."""

    def __init__(self) -> None:
        self._gsd: dict[int, dict[str, float]] = {}
        self._island: dict[str, int] = {}

    def settled(self, painted: Painted) -> Painted:
        """The frame at the level where it is to be painted, 0 if it sees no ground; it counts for the others from now on."""
        self._gsd.get(self._island.get(painted.name, -1), {}).pop(painted.name, None)
        self._island[painted.name] = painted.island
        island = self._gsd.setdefault(painted.island, {})
        gsd = resolved(painted.pose, painted.camera)
        if gsd is None:
            return replace(painted, level=0)
        island[painted.name] = gsd
        return replace(painted, level=level_among(gsd, float(np.quantile(list(island.values()), FINER))))
