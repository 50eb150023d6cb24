"""Protocols that a stitching method implements, and selection of the configured one.

The default method and the paper's recipe implement the same two protocols; a third one needs a line in `method_of`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import NamedTuple, Protocol

from gcs_mosaic.baseline.mosaic import PaperMosaic
from gcs_mosaic.baseline.renderer import PaperRenderer
from gcs_mosaic.config.tree import Config
from gcs_mosaic.render.pyramid import TilePicture
from gcs_mosaic.render.render_list import Extent, RenderItem, TileKey
from gcs_mosaic.render.repaint_queue import LoadImage, RepaintQueue, Step
from gcs_mosaic.render.tile_grid import Tile
from gcs_mosaic.stitch.arrays import Bands
from gcs_mosaic.stitch.bundle.worker import WorkerProcess
from gcs_mosaic.stitch.camera.geometry import Camera, Pose
from gcs_mosaic.stitch.features.extraction import Features, extract
from gcs_mosaic.stitch.features.shelf import Shelve
from gcs_mosaic.stitch.graph.observer import Observer, Observers
from gcs_mosaic.stitch.graph.placement import Covered, Outcome, Placement, Rejection, Waiting
from gcs_mosaic.stitch.graph.tearing import HeldOut
from gcs_mosaic.stitch.mapping.islands import Island
from gcs_mosaic.stitch.mapping.journal import Journal
from gcs_mosaic.stitch.mapping.second_look import Finer
from gcs_mosaic.stitch.mosaic import Mosaic
from gcs_mosaic.store.tiles import read_tile


class Stitcher(Protocol):
    """Places frames; see `stitch.mosaic.Mosaic`."""

    @property
    def islands(self) -> list[Island]: ...
    @property
    def problem(self) -> str | None: ...
    def place(
        self, features: Features, name: str, order: int | None = None, aircraft: int | None = None
    ) -> Outcome: ...
    def retry_waiting(self) -> None: ...
    def connect_some(self) -> bool: ...
    def adjust(self, *, everything: bool = False) -> None: ...
    def adjust_in_a_pause(self) -> bool: ...
    def moved(self) -> list[Placement]: ...
    def anchor_drawn_pose(self, name: str, pose: Pose, camera: Camera) -> None: ...
    def placements(self) -> list[Placement]: ...
    def frame_counts(self) -> dict[int, int]: ...
    def covered(self) -> list[Covered]: ...
    def note_whole(self, preview: str, whole: str) -> None: ...
    def replaced(self) -> list[tuple[Covered, tuple[int, int]]]: ...
    def waiting(self) -> list[Waiting]: ...
    def held_out(self) -> dict[int, HeldOut]: ...
    def finish(self) -> list[Rejection]: ...


class TiledMap(Protocol):
    """The painted map as tiles; see `render.compositor.TileCompositor`."""

    @property
    def problem(self) -> str | None: ...
    def tile(self, island: int, tile: Tile) -> TilePicture | None: ...
    def tile_later(self, island: int, tile: Tile) -> Callable[[], TilePicture | None]: ...
    def extent(self, island: int) -> Extent | None: ...
    def look_again(self, names: Iterable[str]) -> None: ...


class Renderer(Protocol):
    """Paints placed frames; see `render.repaint_queue.RepaintQueue`."""

    @property
    def canvas(self) -> TiledMap: ...
    @property
    def has_repaints(self) -> bool: ...
    @property
    def shows_old_range(self) -> bool: ...
    def is_painted(self, name: str) -> bool: ...
    def in_sight(self, features: Features, image: Bands, aircraft: int | None = None) -> Features: ...
    def begin_look(self, name: str, image: Bands, aircraft: int | None = None) -> None: ...
    def paint_new(self, image: Bands, thumbnail: Bands, placement: Placement, order: int) -> set[TileKey]: ...
    def follow(self, placements: Iterable[Placement]) -> None: ...
    def take_away(self, name: str) -> None: ...
    def next_steps(self) -> list[Step]: ...
    def resume(self, shown: Iterable[RenderItem]) -> set[TileKey]: ...
    def painted(self) -> list[RenderItem]: ...
    def final_steps(self, placements: Iterable[Placement]) -> Iterator[list[Step]]: ...
    def close(self) -> None: ...


class Method(NamedTuple):
    """`features_of(image, reduction=)` extracts features for placing; `feature_pixels`: frame size in pixels for the search."""

    stitcher: Stitcher
    renderer: Renderer
    features_of: Callable[..., Features]
    feature_pixels: float


def method_of(
    config: Config,
    worker: WorkerProcess,
    load_original: LoadImage,
    painted: Callable[[RenderItem], None],
    out: Path,
    observer: Observer | None,
    shelve: Shelve,
    finer: Finer,
    *,
    punctual: bool,
    paint_live: bool,
) -> Method:
    """The configured method. `painted` is called for each frame that is painted or repainted.

    `out` holds the tiles written so far, and scratch files; `shelve`: where features go; `finer`: those of a second look.
    """
    if config.method == "paper":
        paper = PaperMosaic(config.paper, config.reduction)
        return Method(paper, PaperRenderer(paper), lambda image, *, reduction: paper.features_of(image), 0.0)
    observers = Observers(Journal(), observer)
    mosaic = Mosaic(config.stitch, worker, punctual=punctual, observer=observers, shelve=shelve, finer=finer)
    renderer = RepaintQueue(
        load_original, painted, config.paint, scratch=out, live=paint_live, load_tile=partial(read_tile, out)
    )
    features = config.stitch.features
    return Method(mosaic, renderer, partial(extract, settings=features), features.megapixels * 1e6)
