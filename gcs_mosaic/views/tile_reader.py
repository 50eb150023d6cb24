"""Reading tiles with their holes filled, singly or as an image of a whole island.

A tile on disk holds only what was seen at its level. Tiles may change or vanish while being read; a missing, truncated or
invalid tile counts as unseen.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np

from gcs_mosaic.render.tile_cache import full_coverage
from gcs_mosaic.render.tile_grid import TILE_SIZE, Box, Tile, level_from_canvas, pixel_size, tiles_over
from gcs_mosaic.stitch.arrays import ImageBGRA
from gcs_mosaic.store.tile_header import is_tile_sized
from gcs_mosaic.store.tiles import ReadMask, encode, encode_jpeg, read_mask
from gcs_mosaic.views.hole_filling import WrittenTiles, fade, filled_picture
from gcs_mosaic.views.noted_tiles import NotedTiles, TilesRead

FILLED_QUALITY = 90  # JPEG and WebP; tiles made here are displayed and discarded


@dataclass(frozen=True, slots=True)
class EncodedTile:
    """`made_of`: what was read for it, where that is known."""

    data: bytes
    media_type: str
    made_of: TilesRead = field(default_factory=TilesRead, compare=False)


def filled(
    root: Path, island: int, tile: Tile, masks: ReadMask = read_mask, before: EncodedTile | None = None
) -> EncodedTile | None:
    """A tile for display, the one of `before` if all is as it was then; None where nothing was seen at any level.

    JPEG if there are no holes (a full tile's bytes are passed on unchanged), else WebP with alpha: a tenth of the
    size of PNG for three times its time (4 ms).
    """
    tiles = NotedTiles(root, island, masks)
    if before is not None and before.made_of and tiles.are_as(before.made_of):
        return before
    straight = _full_tile(tiles, tile)
    if straight is not None:
        return EncodedTile(straight, "image/jpeg", tiles.read_so_far())
    picture = filled_picture(tiles, tile)
    if picture is None:
        return None
    if int(picture.coverage.min()) == 255:
        return EncodedTile(
            encode_jpeg(picture.colour, picture.coverage, FILLED_QUALITY), "image/jpeg", tiles.read_so_far()
        )
    bgra = np.dstack([picture.colour, picture.coverage])
    return EncodedTile(
        encode(".webp", bgra, [cv2.IMWRITE_WEBP_QUALITY, FILLED_QUALITY]), "image/webp", tiles.read_so_far()
    )


def picture(root: Path, island: int, bounds: Box, level: int) -> ImageBGRA:
    """A canvas box as one image at a level, BGRA (h, w, 4), transparent where nothing was seen.

    It needs memory for its result and one tile. `level_within` finds a level within a limit.
    """
    left, top, right, bottom = pixel_bounds(bounds, level)
    result = np.zeros((bottom - top, right - left, 4), np.uint8)
    for tile in tiles_over(bounds, level):
        seen = filled_picture(WrittenTiles(root, island), tile)
        if seen is not None:
            x, y = tile.x * TILE_SIZE, tile.y * TILE_SIZE
            rows = slice(max(top - y, 0), max(bottom - y, 0))
            columns = slice(max(left - x, 0), max(right - x, 0))
            part = np.dstack([seen.colour, seen.coverage])[rows, columns]
            into = result[max(y - top, 0) :, max(x - left, 0) :]
            into[: part.shape[0], : part.shape[1]] = part
    return result


def pixel_bounds(bounds: Box, level: int) -> tuple[int, int, int, int]:
    """The pixels of a level that a canvas box touches: left, top, and right, bottom exclusive."""
    left, top, right, bottom = level_from_canvas(level, np.array(bounds)).tolist()
    return math.floor(left), math.floor(top), math.ceil(right), math.ceil(bottom)


def level_within(bounds: Box, most_pixels: int, finest: int) -> int:
    """The finest level, at most `finest`, at which an image of a box has at most `most_pixels` pixels."""
    area = (bounds[2] - bounds[0]) * (bounds[3] - bounds[1])
    level = finest
    while level > 0 and area / pixel_size(level) ** 2 > most_pixels:
        level -= 1
    return level


def _full_tile(tiles: NotedTiles, tile: Tile) -> bytes | None:
    if tiles.mask(tile) is not full_coverage(TILE_SIZE):
        return None
    data = tiles.data(tile)
    if data is None or not is_tile_sized(data):
        return None
    return None if fade(tiles, tile) is not None else data
