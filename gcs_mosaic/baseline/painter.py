"""The paper's method (`--method paper`) where the pipeline expects a painter: a frame is painted once, and never again."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from functools import partial

from gcs_mosaic.baseline.mosaic import PaperMosaic
from gcs_mosaic.baseline.raster import Raster
from gcs_mosaic.render.painted import Extent, TileKey
from gcs_mosaic.render.pyramid import TilePicture
from gcs_mosaic.render.repaint_queue import Step
from gcs_mosaic.render.tile_grid import Tile
from gcs_mosaic.stitch.camera.bands import Bands
from gcs_mosaic.stitch.features.extraction import Features
from gcs_mosaic.stitch.graph.placement import Placement
from gcs_mosaic.stitch.transaction import Kept

ISLAND = 0  # the only one: what does not match is refused


class PaperCanvas:
    """The paper's one picture, in tiles."""

    problem: str | None = None

    def __init__(self, raster: Raster) -> None:
        self._raster = raster

    def tile(self, island: int, tile: Tile) -> TilePicture | None:
        """A tile as it is shown; None if there is nothing on it."""
        return self._raster.tile(tile) if island == ISLAND else None

    def tile_later(self, island: int, tile: Tile) -> Callable[[], TilePicture | None]:
        """What gives a tile as it is shown now."""
        return partial(lambda picture: picture, self.tile(island, tile))

    def extent(self, island: int) -> Extent | None:
        """The canvas box of the picture and the levels it has tiles of; None while it is empty."""
        return self._raster.extent() if island == ISLAND else None


class PaperPainter(Kept):
    """Paints on the paper's mosaic; there is nothing to repaint."""

    FIXED = frozenset({"_mosaic", "canvas"})  # the picture is the mosaic's

    has_repaints = False

    def __init__(self, mosaic: PaperMosaic) -> None:
        self._mosaic = mosaic
        self._painted: set[str] = set()
        self.canvas = PaperCanvas(mosaic.raster)

    def is_painted(self, name: str) -> bool:
        return name in self._painted

    def in_sight(self, features: Features, image: Bands) -> Features:
        """The paper's method takes all features."""
        return features

    def begin_look(self, name: str, image: Bands) -> None:
        """The paper's method looks at nothing but what it matches."""

    def paint_new(self, image: Bands, thumbnail: object, placement: Placement, order: int) -> set[TileKey]:
        """Blend a frame into the picture; returns the tiles that look different now."""
        self._painted.add(placement.name)
        return {(ISLAND, tile) for tile in self._mosaic.paint(image, placement.name)}

    def follow(self, placements: Iterable[Placement]) -> None:
        """No frame moves."""

    def next_steps(self) -> list[Step]:
        """Nothing is ever repainted."""
        return []

    def final_steps(self, placements: Iterable[Placement]) -> Iterator[list[Step]]:
        """Nothing is ever repainted."""
        return iter(())

    def close(self) -> None:
        """There is nothing to give back."""
