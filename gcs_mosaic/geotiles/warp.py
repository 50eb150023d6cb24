"""The warp of an island's canvas tiles into a picture of the earth.

The canvas' level is chosen so that a pixel of the picture is one to two of the canvas', then four samples make a pixel: a mean
over about its area, and no aliasing. The way from a pixel to the canvas leads over Mercator, the ellipsoid and the anchor; it
bends so little within a picture of 256 px that it is computed at 17 x 17 places and taken as straight between them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from gcs_mosaic.geotiles.canvas_tiles import CanvasTiles
from gcs_mosaic.geotiles.earth_islands import EarthIsland
from gcs_mosaic.geotiles.picture_grid import PictureGrid
from gcs_mosaic.render.tile_grid import BASE_LEVEL, TILE_SIZE, Tile, level_from_canvas, pixel_size
from gcs_mosaic.stitch.arrays import AnyImage, FloatImage

NODES = 17  # exact places along each side of a window
MARGIN_PX = 2  # about an island's bounds in a picture, and about what a window needs of the canvas
UNEQUAL = 4.0  # a pixel's longer side by its shorter one, beyond which its shorter side is sampled too finely
MOST_SAMPLES = 8  # along a side of a pixel


class PixelWindow(NamedTuple):
    """Pixels of a picture: left, top, and right, bottom exclusive."""

    left: int
    top: int
    right: int
    bottom: int


class Sampling(NamedTuple):
    """The level of the canvas that is read, and samples along each side of a pixel."""

    level: int
    across: int
    down: int


@dataclass(frozen=True, slots=True)
class SourcePlaces:
    """Where samples lie on a level of the canvas: `x`, `y` (rows, columns) in pixels from the outer edge of pixel (left, top)."""

    left: int
    top: int
    x: FloatImage
    y: FloatImage


def windows(grid: PictureGrid, island: EarthIsland) -> Iterator[PixelWindow]:
    """The parts of a picture that an island may lie in; two where it lies across the 180th meridian."""
    west, south, east, north = grid.bounds_of(island)
    (left, _, _, top), (across, down) = grid.bounds, grid.steps
    for turn in (-1, 0, 1):
        shifted = turn * grid.once_round - left
        columns = _touched((west + shifted) / across, (east + shifted) / across, grid.width)
        rows = _touched((top - north) / down, (top - south) / down, grid.height)
        if columns is not None and rows is not None:
            yield PixelWindow(columns[0], rows[0], columns[1], rows[1])


def sampling_of(grid: PictureGrid, island: EarthIsland) -> Sampling:
    """The same for all windows of a picture, and for all tiles of a level, so that no border of theirs is seen."""
    across, down = (
        length / island.anchor.metres_per_unit for length in grid.ground_m(island.latitude_deg)
    )  # canvas units
    size = max(min(across, down), max(across, down) / UNEQUAL)
    level = math.floor(BASE_LEVEL - math.log2(size) + 1 - 1e-9)
    level = min(max(level, 0), island.finest)
    samples = (_samples(side / pixel_size(level)) for side in (across, down))
    return Sampling(level, *samples)


def warped(grid: PictureGrid, window: PixelWindow, island: EarthIsland, tiles: CanvasTiles) -> AnyImage | None:
    """A window of a picture (h, w, channels), of the tiles' type, colour multiplied by coverage; None if nothing of the island is
    in it."""
    sampling = sampling_of(grid, island)
    places = source_places(grid, window, island, sampling)
    patch = _patch(island, sampling.level, places, tiles)
    if patch is None:
        return None
    image, left, top = patch
    x = places.x + np.float32(places.left - left - 0.5)
    y = places.y + np.float32(places.top - top - 0.5)
    size = window.right - window.left, window.bottom - window.top
    parts = [_resampled(image[..., at : at + 4], x, y, size) for at in range(0, image.shape[2], 4)]
    return parts[0] if len(parts) == 1 else np.dstack(parts)


def _resampled(image: AnyImage, x: FloatImage, y: FloatImage, size: tuple[int, int]) -> AnyImage:
    """At most four channels: samples at places of an image, and their means."""
    samples = cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=0)
    return samples if size == samples.shape[1::-1] else cv2.resize(samples, size, interpolation=cv2.INTER_AREA)


def source_places(grid: PictureGrid, window: PixelWindow, island: EarthIsland, sampling: Sampling) -> SourcePlaces:
    """Where the samples of a window lie on a level of the canvas."""
    columns, rows = (np.linspace(first, last, NODES) for first, last in (window[::2], window[1::2]))
    canvas = island.anchor.canvas(grid.places(columns, rows))
    nodes = level_from_canvas(sampling.level, canvas)
    across = _between((window.right - window.left) * sampling.across)
    down = _between((window.bottom - window.top) * sampling.down)
    left, top = np.floor(nodes.min(axis=(0, 1))).astype(int).tolist()
    x, y = (nodes[..., 0] - left).astype(np.float32), (nodes[..., 1] - top).astype(np.float32)
    return SourcePlaces(left, top, down @ x @ across.T, down @ y @ across.T)


def _between(samples: int) -> FloatImage:
    """(samples, NODES): how much each node counts at the middle of each of the samples between the first and the last node."""
    at = (np.arange(samples) + 0.5) / samples * (NODES - 1)
    return np.asarray(np.maximum(0, 1 - np.abs(at[:, None] - np.arange(NODES))), dtype=np.float32)


def _touched(first: float, last: float, size: int) -> tuple[int, int] | None:
    """The pixels between two edges, with a margin; None if there are none within the picture."""
    low, high = max(math.floor(first) - MARGIN_PX, 0), min(math.ceil(last) + MARGIN_PX, size)
    return (low, high) if low < high else None


def _samples(pixels: float) -> int:
    """A power of two, at least as many as pixels of the canvas along a side."""
    return min(1 << max(math.ceil(math.log2(pixels) - 1e-9), 0), MOST_SAMPLES)


def _patch(
    island: EarthIsland, level: int, places: SourcePlaces, tiles: CanvasTiles
) -> tuple[AnyImage, int, int] | None:
    """The part of a level that samples touch, and its first column and row; None if nothing was seen there."""
    box = level_from_canvas(level, np.array(island.box))
    first = places.left + float(places.x.min()), places.top + float(places.y.min())
    last = places.left + float(places.x.max()), places.top + float(places.y.max())
    low = [math.floor(max(pair)) - MARGIN_PX for pair in zip(first, box[:2], strict=True)]
    high = [math.ceil(min(pair)) + MARGIN_PX for pair in zip(last, box[2:], strict=True)]
    if low[0] >= high[0] or low[1] >= high[1]:
        return None
    image: AnyImage | None = None
    for y in range(low[1] // TILE_SIZE, (high[1] - 1) // TILE_SIZE + 1):
        for x in range(low[0] // TILE_SIZE, (high[0] - 1) // TILE_SIZE + 1):
            tile = tiles(island, Tile(level, x, y))
            if tile is not None:
                if image is None:
                    image = np.zeros((high[1] - low[1], high[0] - low[0], tile.shape[2]), tile.dtype)
                _put(image, tile, x * TILE_SIZE - low[0], y * TILE_SIZE - low[1])
    return None if image is None else (image, low[0], low[1])


def _put(image: AnyImage, tile: AnyImage, left: int, top: int) -> None:
    """A tile into a larger picture, as far as it lies within."""
    part = tile[max(-top, 0) :, max(-left, 0) :]
    into = image[max(top, 0) : max(top + TILE_SIZE, 0), max(left, 0) : max(left + TILE_SIZE, 0)]
    into[...] = part[: into.shape[0], : into.shape[1]]
