"""Which geo tiles look different after tiles of the canvas were painted."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
import numpy.typing as npt

from gcs_mosaic.geo.ellipsoid import Floats
from gcs_mosaic.geo.mercator import HALF_WORLD_M, TILE_SIZE, mercator, resolution_m, tile_corner
from gcs_mosaic.geotiles.earth_islands import EarthIsland, outline_of
from gcs_mosaic.geotiles.picture_grid import grid_of_tile
from gcs_mosaic.geotiles.warp import sampling_of
from gcs_mosaic.render.tile_grid import Tile, ancestor, tile_box

ROOM_PX = 2.0  # of the geo tile: what samples and their interpolation reach beyond it


def touched(
    island: EarthIsland, painted: Collection[Tile], level: int, tiles: npt.NDArray[np.int64]
) -> npt.NDArray[np.bool_]:
    """Of geo tiles of a level, (n, 2) x and y, those that show something of painted tiles or beside them.

    A canvas tile fades towards its neighbours, its ancestors are painted with it, and finer ones are filled from it. So what
    looks different is that tile or, where a coarser level is shown, its ancestor there, and those beside it.
    """
    if not painted or not len(tiles):
        return np.zeros(len(tiles), bool)
    middle = grid_of_tile(level, *map(int, tiles[0]))
    shown = max(sampling_of(middle, island).level, island.coarsest)
    changed = {ancestor(tile, min(shown, tile.z)) for tile in painted}
    areas = _areas(island, changed)
    side, count = resolution_m(level) * TILE_SIZE, 1 << level
    west, north = tile_corner(level, 0, 0)
    columns = (areas[:, [0, 2]] - west) / side
    rows = (north - areas[:, [3, 1]]) / side
    room = ROOM_PX / TILE_SIZE
    x, y = tiles[:, None, 0], tiles[:, None, 1]
    is_level = (rows[:, 0] - room < y + 1) & (rows[:, 1] + room > y)
    is_near = [(columns[:, 0] - room < x + 1 + turn) & (columns[:, 1] + room > x + turn) for turn in (-count, 0, count)]
    found: npt.NDArray[np.bool_] = (is_level & np.logical_or.reduce(is_near)).any(axis=1)
    return found


def _areas(island: EarthIsland, tiles: Collection[Tile]) -> Floats:
    """(n, 4) west, south, east and north (metres of Mercator) of canvas tiles with their neighbours."""
    boxes = np.array([tile_box(tile) for tile in tiles])
    low, side = boxes[:, None, :2], (boxes[:, 2:] - boxes[:, :2])[:, None]
    places = island.anchor.places(low + side * (3 * outline_of((0.0, 0.0, 1.0, 1.0), 2) - 1))
    first = island.outline[0, 0]
    places[..., 0] = first + (places[..., 0] - first + 180) % 360 - 180
    points = mercator(places)
    areas: Floats = np.concatenate([points.min(axis=1), points.max(axis=1)], axis=1)
    # A tile that reaches too far from what the anchor was made of may lie anywhere.
    areas[np.isnan(areas).any(axis=1)] = -2 * HALF_WORLD_M, -HALF_WORLD_M, 2 * HALF_WORLD_M, HALF_WORLD_M
    return areas
