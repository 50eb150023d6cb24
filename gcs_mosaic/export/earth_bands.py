"""`gcs-mosaic export --format geotiff|cog --bands`: all bands of the frames at their depth, painted again from the originals and
warped to the earth as the tiles are."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from gcs_mosaic.errors import UsageError
from gcs_mosaic.export.earth_map import EarthMap
from gcs_mosaic.export.earth_raster import Bandwise
from gcs_mosaic.export.multiband_tiff import bands_of, left_out, unit_of
from gcs_mosaic.export.rebuild import RebuildSource, RebuiltTiles, rebuilt, source_of
from gcs_mosaic.geotiles.canvas_tiles import touches
from gcs_mosaic.geotiles.earth_islands import EarthIsland
from gcs_mosaic.geotiles.picture_grid import PictureGrid
from gcs_mosaic.geotiles.pyramid import blocks
from gcs_mosaic.geotiles.warp import warped, windows
from gcs_mosaic.render.tile_grid import TILE_SIZE, Tile
from gcs_mosaic.stitch.arrays import AnyImage, FloatImage
from gcs_mosaic.views.hole_filling import filled_picture

KEPT = 48  # filled tiles in memory: 2 MB each with eight bands
FULL = 255  # coverage of what was seen wholly


@contextmanager
def painted_again(found: EarthMap, target: Path, *, gains: bool) -> Iterator[Bandwise]:
    """What is written of each pixel. `gains`: with gain compensation between frames, as on the map; else the raw counts.

    What does not fit into memory lies beside the target. Raises UsageError, also if the islands' frames have other bands.
    """
    root = found.view.root
    sources = {one.id: source_of(root, one.id) for one in found.pyramid.islands}
    bands, kind = _common_bands(sources)
    with ExitStack() as stack:
        islands = {
            number: stack.enter_context(rebuilt(source, "gained" if gains else "raw", target.resolve().parent))
            for number, source in sources.items()
        }
        told = "".join(left_out(source) for source in sources.values())
        unit, no_degrees = unit_of(found.view, list(sources), gains=gains)
        yield Bandwise(_Drawing(found, islands, bands, kind).draw, bands, kind, told + no_degrees, unit)


class _Drawing:
    """Pictures of the whole map with all bands."""

    def __init__(self, found: EarthMap, islands: dict[int, RebuiltTiles], bands: int, kind: np.dtype[Any]) -> None:
        self._map, self._rebuilt, self._bands, self._kind = found, islands, bands, kind
        self._tile = lru_cache(KEPT)(self._read)

    def draw(self, grid: PictureGrid) -> AnyImage | None:
        """(h, w, bands and coverage) of the frames' type; None where nothing was seen."""
        picture: FloatImage | None = None
        for island in self._map.pyramid.islands:
            for window in windows(grid, island):
                for block in blocks(window):
                    part = warped(grid, block, island, self._tile)
                    if part is not None:
                        picture = (
                            np.zeros((grid.height, grid.width, self._bands + 1), np.float32)
                            if picture is None
                            else picture
                        )
                        below = picture[block.top : block.bottom, block.left : block.right]
                        below[...] = part + below * (1 - part[..., -1:] / FULL)
        return None if picture is None or not picture.any() else self._counts(picture)

    def _counts(self, picture: FloatImage) -> AnyImage:
        """What is multiplied by coverage, as it is written."""
        most = np.iinfo(self._kind).max
        coverage = np.rint(picture[..., -1:])
        share = np.maximum(picture[..., -1:], np.float32(0.5)) / FULL
        bands = np.where(coverage > 0, np.rint(picture[..., :-1] / share).clip(0, most), 0)
        return np.concatenate([bands, coverage * (most // FULL)], axis=-1).astype(self._kind)

    def _read(self, island: EarthIsland, tile: Tile) -> FloatImage | None:
        """A tile as `CanvasTiles` gives it; coarser than the coarsest that is painted, it is made of its four children."""
        if not touches(island, tile):
            return None
        tiles = self._rebuilt[island.id]
        if tile.z < tiles.extent.coarsest:
            return _halved([self._tile(island, child) for child in tile.children])
        seen = filled_picture(tiles, tile)
        if seen is None or seen.bands is None:
            return None
        bands = seen.bands[..., ::-1] if self._bands == 3 else seen.bands  # red first
        coverage = seen.coverage.astype(np.float32)[..., None]
        return np.concatenate([bands * (coverage / FULL), coverage], axis=-1)


def _halved(children: list[FloatImage | None]) -> FloatImage | None:
    """Four tiles (top left, top right, bottom left, bottom right) as one of half their size."""
    seen = [child for child in children if child is not None]
    if not seen:
        return None
    half = TILE_SIZE // 2
    whole = np.zeros_like(seen[0])
    for at, child in enumerate(children):
        if child is not None:
            top, left = at // 2 * half, at % 2 * half
            whole[top : top + half, left : left + half] = child.reshape(half, 2, half, 2, -1).mean(axis=(1, 3))
    return whole


def _common_bands(sources: dict[int, RebuildSource]) -> tuple[int, np.dtype[Any]]:
    kinds = {number: bands_of(source) for number, source in sources.items()}
    if len(set(kinds.values())) > 1:
        told = ", ".join(
            f"island {number}: {bands} of {8 * kind.itemsize} bits" for number, (bands, kind) in kinds.items()
        )
        raise UsageError(f"The islands' frames have other bands ({told}): give --island.")
    return next(iter(kinds.values()))
