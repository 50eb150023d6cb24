"""The paper's method (`--method paper`) as a renderer for the pipeline: a frame is painted once and never again."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from functools import partial

from gcs_mosaic.baseline.mosaic import PaperMosaic
from gcs_mosaic.baseline.raster import Raster
from gcs_mosaic.render.pyramid import TilePicture
from gcs_mosaic.render.render_list import Extent, RenderItem, TileKey
from gcs_mosaic.render.repaint_queue import Step
from gcs_mosaic.render.tile_grid import Tile
from gcs_mosaic.stitch.arrays import Bands
from gcs_mosaic.stitch.features.extraction import Features
from gcs_mosaic.stitch.graph.placement import Placement
from gcs_mosaic.stitch.transaction import Kept

ISLAND = 0  # the only one: unmatched frames are refused


class PaperCanvas:
    """The paper's single image, in tiles."""

    problem: str | None = None

    def __init__(self, raster: Raster) -> None:
        self._raster = raster

    def tile(self, island: int, tile: Tile) -> TilePicture | None:
        """A tile as displayed; None if empty."""
        return self._raster.tile(tile) if island == ISLAND else None

    def tile_later(self, island: int, tile: Tile) -> Callable[[], TilePicture | None]:
        """A callable that returns the tile as displayed now."""
        return partial(lambda picture: picture, self.tile(island, tile))

    def extent(self, island: int) -> Extent | None:
        """Canvas box of the image and its range of tile levels; None while empty."""
        return self._raster.extent() if island == ISLAND else None

    def look_again(self, names: Iterable[str]) -> None:
        """Nothing is ever painted from an original again."""


class PaperRenderer(Kept):
    """Paints on the paper's mosaic; never repaints."""

    FIXED = frozenset({"_mosaic", "canvas"})  # the image belongs to the mosaic

    has_repaints = False
    shows_old_range = False

    def __init__(self, mosaic: PaperMosaic) -> None:
        self._mosaic = mosaic
        self._painted: set[str] = set()
        self.canvas = PaperCanvas(mosaic.raster)

    def is_painted(self, name: str) -> bool:
        return name in self._painted

    def in_sight(self, features: Features, image: Bands, aircraft: int | None = None) -> Features:
        """The paper's method uses all features."""
        return features

    def begin_look(self, name: str, image: Bands, aircraft: int | None = None) -> None:
        """The paper's method needs no look."""

    def paint_new(self, image: Bands, thumbnail: object, placement: Placement, order: int) -> set[TileKey]:
        """Blend a frame into the image; returns the tiles that changed."""
        self._painted.add(placement.name)
        return {(ISLAND, tile) for tile in self._mosaic.paint(image, placement.name)}

    def follow(self, placements: Iterable[Placement]) -> None:
        """No frames move."""

    def take_away(self, name: str) -> None:
        """What is blended in stays."""

    def next_steps(self) -> list[Step]:
        """Nothing is ever repainted."""
        return []

    def resume(self, shown: Iterable[RenderItem]) -> set[TileKey]:
        """Cannot be done: the recipe's one picture is in memory only."""
        raise NotImplementedError("a map of the paper's recipe cannot be resumed")

    def painted(self) -> list[RenderItem]:
        """Nothing is painted frame by frame."""
        return []

    def final_steps(self, placements: Iterable[Placement]) -> Iterator[list[Step]]:
        """Nothing is ever repainted."""
        return iter(())

    def close(self) -> None:
        """Nothing to release."""
