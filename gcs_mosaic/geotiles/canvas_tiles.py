"""The canvas' tiles as the warp reads them: holes filled, colour multiplied by coverage, coarser ones than there are on disk."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache, partial
from pathlib import Path
from typing import TypeAlias

import cv2
import numpy as np

from gcs_mosaic.geotiles.earth_islands import EarthIsland
from gcs_mosaic.render.tile_grid import TILE_SIZE, Tile, level_from_canvas
from gcs_mosaic.stitch.arrays import AnyImage, ImageBGRA
from gcs_mosaic.views.hole_filling import WrittenTiles, filled_picture

KEPT = 128  # tiles in memory while a flight at rest is read: 256 KB each

# A tile of an island's canvas, BGRA (256, 256, 4), or bands and coverage, multiplied by coverage; None where nothing was seen.
CanvasTiles: TypeAlias = Callable[[EarthIsland, Tile], AnyImage | None]


def tiles_at_rest(root: Path) -> CanvasTiles:
    """The tiles of a flight that nobody paints on any more."""
    return lru_cache(KEPT)(partial(canvas_tile, root))


def canvas_tile(root: Path, island: EarthIsland, tile: Tile) -> ImageBGRA | None:
    """A tile as it is on disk now; coarser than the coarsest there, it is made of its four children."""
    if not touches(island, tile):
        return None
    if tile.z < island.coarsest:
        return _shrunk([canvas_tile(root, island, child) for child in tile.children])
    seen = filled_picture(WrittenTiles(root, island.id), tile)
    if seen is None:
        return None
    whole = np.dstack([seen.colour, seen.coverage])
    return whole if int(seen.coverage.min()) == 255 else multiplied(whole)


def touches(island: EarthIsland, tile: Tile) -> bool:
    """Whether a tile has a part in an island's box."""
    left, top, right, bottom = level_from_canvas(tile.z, np.array(island.box)) / TILE_SIZE
    return bool(left < tile.x + 1 and right > tile.x and top < tile.y + 1 and bottom > tile.y)


def multiplied(image: ImageBGRA) -> ImageBGRA:
    """With the colours multiplied by coverage, so that what was not seen has no part in a mean."""
    coverage = image[..., 3:]
    colour = np.rint(image[..., :3] * (coverage / np.float32(255))).astype(np.uint8)
    return np.dstack([colour, coverage])


def divided(image: ImageBGRA) -> ImageBGRA:
    """The inverse of `multiplied`: as pictures are saved."""
    coverage = image[..., 3:]
    if int(coverage.min()) == 255:
        return image
    colour = np.rint(image[..., :3] * (np.float32(255) / np.maximum(coverage, 1)))
    return np.dstack([np.minimum(colour, 255).astype(np.uint8), coverage])


def _shrunk(children: list[ImageBGRA | None]) -> ImageBGRA | None:
    """Four tiles (top left, top right, bottom left, bottom right) as one of half their size."""
    if all(child is None for child in children):
        return None
    nothing = np.zeros((TILE_SIZE, TILE_SIZE, 4), np.uint8)
    upper_left, upper_right, lower_left, lower_right = (nothing if child is None else child for child in children)
    whole = np.vstack([np.hstack([upper_left, upper_right]), np.hstack([lower_left, lower_right])])
    return np.asarray(cv2.resize(whole, (TILE_SIZE, TILE_SIZE), interpolation=cv2.INTER_AREA), dtype=np.uint8)
