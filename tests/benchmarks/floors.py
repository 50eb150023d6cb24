"""The least that a frame on the map can cost: its file decoded, warped once as a whole, and its tiles encoded."""

from __future__ import annotations

import statistics
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.config.tree import Config
from gcs_mosaic.frames.decode import Unreadable, load_image
from gcs_mosaic.render.compositor import INTERPOLATIONS
from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.render.tile_cache import full_coverage
from gcs_mosaic.render.tile_grid import TILE_SIZE, canvas_from_level, level_from_canvas
from gcs_mosaic.stitch.camera.geometry import canvas_from_pixels, pixels_from_canvas
from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.tiles import encode_jpeg
from tests.benchmarks.stages import Stages

LATTICE = 64  # px between places whose pixel is worked out; between them it is interpolated, and none of it counts


@dataclass(frozen=True, slots=True)
class Floor:
    """Seconds on one thread, by the clock on the wall; `cpu`: of the processor, for all of it."""

    decode: float
    warp: float
    encode: float
    cpu: float = 0.0

    @property
    def all(self) -> float:
        return self.decode + self.warp + self.encode


def floor_of(flight: Path, config: Config, most: int = 9) -> Floor:
    """The median of at most so many frames of a stitched flight, spread over it, as they are painted."""
    with Ledger(flight / LEDGER_NAME, read_only=True) as ledger:
        painted = [one for island in ledger.islands() for one in ledger.painted(island.id)]
        paths = {frame.name: flight / frame.original for frame in ledger.frames() if frame.original}
    chosen = {painted[at].name: painted[at] for at in np.linspace(0, len(painted) - 1, most).astype(int)}
    with one_thread():
        floors = sorted((floor(paths[one.name], one, config) for one in chosen.values()), key=lambda found: found.all)
    each = zip(*[(found.decode, found.warp, found.encode, found.cpu) for found in floors], strict=True)
    return Floor(*map(statistics.median, each))


@contextmanager
def one_thread() -> Iterator[None]:
    """OpenCV works on one thread meanwhile."""
    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(before)


def floor(original: Path, painted: RenderItem, config: Config) -> Floor:
    """Of one frame: its own picture alone, at the level at which it is painted, on the tiles under its footprint."""
    spent = Stages()
    with spent.timed("decode"):
        image = load_image(original, reduction=config.reduction)
    assert not isinstance(image, Unreadable), image.reason
    pixels, under = pixels_of(painted)
    flag = INTERPOLATIONS[config.paint.canvas.interpolation]
    places = [pixels[row : row + TILE_SIZE, column : column + TILE_SIZE] for row, column in under]
    with spent.timed("warp"):  # of these tiles alone: the box around a turned frame is twice as large
        warped = [cv2.remap(image, at, None, flag, borderMode=cv2.BORDER_REPLICATE) for at in places]  # type: ignore
    with spent.timed("encode"):
        full = full_coverage(TILE_SIZE)
        for tile in warped:
            encode_jpeg(np.asarray(tile, np.uint8), full, config.tiles.jpeg_quality)
    return Floor(**spent.wall_s, cpu=sum(spent.cpu_s.values()))


def pixels_of(painted: RenderItem) -> tuple[NDArray[np.float32], list[tuple[int, int]]]:
    """The frame's pixel (h, w, 2) at every pixel of the whole tiles around its footprint, and the first row and column of each
    tile that shows any of it."""
    size = np.array([painted.camera.width, painted.camera.height])
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * size - 0.5
    outline = level_from_canvas(painted.level, canvas_from_pixels(painted.pose, painted.camera, corners))
    least = np.floor(outline.min(axis=0) / TILE_SIZE).astype(int) * TILE_SIZE
    wide, high = (np.ceil(outline.max(axis=0) / TILE_SIZE).astype(int) * TILE_SIZE - least).tolist()
    grid = np.stack(np.meshgrid(np.arange(0, wide + 1, LATTICE), np.arange(0, high + 1, LATTICE)), axis=-1)
    places = canvas_from_level(painted.level, (grid + least).reshape(-1, 2).astype(np.float64))
    coarse = pixels_from_canvas(painted.pose, painted.camera, places).reshape(grid.shape).astype(np.float32)
    inside = np.asarray(((coarse >= 0) & (coarse < size)).all(axis=-1))
    step = TILE_SIZE // LATTICE
    under = [
        (row, column)
        for row in range(0, high, TILE_SIZE)
        for column in range(0, wide, TILE_SIZE)
        if inside[row // LATTICE :, column // LATTICE :][: step + 1, : step + 1].any()
    ]
    return np.asarray(cv2.resize(coarse, (wide, high), interpolation=cv2.INTER_LINEAR), np.float32), under
