"""Selection of the configured stitching method.

One is a `Mosaic` that places frames and a `RepaintQueue` that paints them; the paper's recipe is a special case of both.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NamedTuple

from gcs_mosaic.baseline.mosaic import PaperMosaic
from gcs_mosaic.baseline.renderer import PaperRenderer
from gcs_mosaic.config.tree import Config
from gcs_mosaic.render.compositor import TileCompositor
from gcs_mosaic.render.originals import LoadImage
from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.render.repaint_queue import RepaintQueue
from gcs_mosaic.stitch.bundle.worker import WorkerProcess
from gcs_mosaic.stitch.features.extraction import Features, extract
from gcs_mosaic.stitch.features.shelf import Shelve
from gcs_mosaic.stitch.graph.observer import Observer, Observers
from gcs_mosaic.stitch.mapping.journal import Journal
from gcs_mosaic.stitch.mapping.second_look import Finer
from gcs_mosaic.stitch.mosaic import Mosaic
from gcs_mosaic.store.tiles import read_tile


class Method(NamedTuple):
    """`features_of(image, reduction=)` extracts features for placing; `feature_pixels`: frame size in pixels for the search."""

    mosaic: Mosaic
    renderer: RepaintQueue
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

    `out` holds the tiles written so far, and scratch files; `shelve`: for features and thumbnails; `finer`: of a second look.
    """
    if config.method == "paper":
        paper = PaperMosaic(config.paper, config.reduction)
        return Method(paper, PaperRenderer(paper), lambda image, *, reduction: paper.features_of(image), 0.0)
    observers = Observers(Journal(), observer)
    mosaic = Mosaic(config.stitch, worker, punctual=punctual, observer=observers, shelve=shelve, finer=finer)
    canvas = TileCompositor(load_original, config.paint.canvas, load_tile=partial(read_tile, out), scratch=out)
    renderer = RepaintQueue(canvas, painted, config.paint, live=paint_live, shelve=shelve)
    features = config.stitch.features
    return Method(mosaic, renderer, partial(extract, settings=features), features.megapixels * 1e6)
