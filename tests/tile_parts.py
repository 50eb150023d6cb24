"""Where a tile's pixels lie, and at which level a frame is painted alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.render.tile_grid import TILE_SIZE, Tile, canvas_from_level, painting_level
from gcs_mosaic.render.warp_grid import resolved
from gcs_mosaic.stitch.camera.geometry import Camera, Pose


def own_level(pose: Pose, camera: Camera) -> int:
    """The level that suits a single frame; 0 if it sees no ground."""
    gsd = resolved(pose, camera)
    return 0 if gsd is None else painting_level(gsd)


def pixel_centres(tile: Tile) -> NDArray[np.float64]:
    """Canvas places of a tile's pixel centres, (256, 256, 2), rows first."""
    x, y = (
        canvas_from_level(tile.z, np.arange(TILE_SIZE, dtype=np.float64) + 0.5 + i * TILE_SIZE)
        for i in (tile.x, tile.y)
    )
    return np.stack(np.meshgrid(x, y), axis=-1)
