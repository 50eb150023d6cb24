"""The paper's method (`--method paper`) as a renderer for the pipeline: a frame is painted once and never again."""

from __future__ import annotations

from collections.abc import Callable

from gcs_mosaic.baseline.mosaic import PaperMosaic
from gcs_mosaic.baseline.raster import Raster
from gcs_mosaic.render.compositor import TileCompositor
from gcs_mosaic.render.pyramid import TilePicture
from gcs_mosaic.render.render_list import Extent, TileKey
from gcs_mosaic.render.repaint_queue import PaintSettings, RepaintQueue
from gcs_mosaic.render.tile_grid import Tile
from gcs_mosaic.stitch.arrays import Bands
from gcs_mosaic.stitch.graph.placement import Placement

ISLAND = 0  # the only one: unmatched frames are refused


class PaperCanvas(TileCompositor):
    """The paper's single image, in tiles; no frame is painted on it as a `RenderItem`."""

    FIXED = TileCompositor.FIXED | {"_raster"}  # it belongs to the mosaic

    def __init__(self, raster: Raster) -> None:
        super().__init__(lambda name: None)
        self._raster = raster

    def tile_later(self, island: int, tile: Tile) -> Callable[[], TilePicture | None]:
        """A callable that returns the tile as displayed now."""
        picture = self._raster.tile(tile)
        return lambda: picture

    def extent(self, island: int) -> Extent | None:
        """Canvas box of the image and its range of tile levels; None while empty."""
        return self._raster.extent()


class PaperRenderer(RepaintQueue):
    """Blends each frame into the paper's mosaic as soon as it is placed: nothing is ever queued."""

    FIXED = RepaintQueue.FIXED | {"_mosaic"}

    def __init__(self, mosaic: PaperMosaic) -> None:
        super().__init__(PaperCanvas(mosaic.raster), lambda painted: None, PaintSettings(), live=False)
        self._mosaic = mosaic
        self._blended: set[str] = set()

    def is_painted(self, name: str) -> bool:
        return name in self._blended

    def paint_new(self, image: Bands, thumbnail: Bands, placement: Placement, order: int) -> set[TileKey]:
        """Blend a frame into the image; returns the tiles that changed."""
        self._blended.add(placement.name)
        return {(ISLAND, tile) for tile in self._mosaic.paint(image, placement.name)}
