"""Coarser tiles: four finer ones at half size, over frames painted at the coarser level itself."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from gcs_mosaic.render.blending import mix
from gcs_mosaic.render.tile_cache import Layer, make_layer
from gcs_mosaic.render.tile_grid import TILE_SIZE
from gcs_mosaic.render.warp_grid import LATTICE
from gcs_mosaic.stitch.arrays import AnyImage, Bands, Coverage
from gcs_mosaic.stitch.camera.bands import resized

# Weight (fraction of the way from a frame's border to its centre) from which the finer image is opaque: some ten pixels.
FEATHER = 0.02


def shrink(layer: Layer) -> Layer | None:
    """A layer at half size: the mean of each 2 x 2 pixels over covered ones; None if nothing remains."""
    weight = np.ascontiguousarray(layer.weight[::2, ::2])
    bands = None if layer.bands is None else _shrunk_bands(layer.bands, None if layer.is_full else layer.coverage)
    if layer.is_full:
        return make_layer(_halved(layer.colour).astype(np.uint8), None, weight, bands)
    seen = _halved(layer.coverage.astype(np.float32))
    total = _halved(np.multiply(layer.colour, cv2.merge([layer.coverage] * 3), dtype=np.uint16)).astype(np.float32)
    mean = np.asarray(cv2.divide(total, cv2.merge([np.maximum(seen, 1)] * 3), dtype=cv2.CV_8U), dtype=np.uint8)
    coverage = np.rint(seen).astype(np.uint8)
    return make_layer(np.asarray(cv2.copyTo(mean, coverage), dtype=np.uint8), coverage, weight, bands)


def assemble(quarters: Sequence[Layer | None]) -> Layer | None:
    """A tile of four quarters (top left, top right, bottom left, bottom right); None if all are empty."""
    if not any(quarters):
        return None
    half, points = TILE_SIZE // 2, LATTICE // 2
    colour = np.zeros((TILE_SIZE, TILE_SIZE, 3), np.uint8)
    coverage = np.zeros((TILE_SIZE, TILE_SIZE), np.uint8)
    weight = np.zeros((LATTICE, LATTICE), np.float32)
    bands: Bands | None = None
    for i, quarter in enumerate(quarters):
        if quarter is not None:
            y, x = divmod(i, 2)
            place = slice(y * half, (y + 1) * half), slice(x * half, (x + 1) * half)
            colour[place], coverage[place] = quarter.colour, quarter.coverage
            if quarter.bands is not None:
                bands = (
                    np.zeros((TILE_SIZE, TILE_SIZE, quarter.bands.shape[2]), quarter.bands.dtype)
                    if bands is None
                    else bands
                )
                bands[place] = quarter.bands
            # Quarters share the lattice points on their common edge.
            shared = weight[y * points : (y + 1) * points + 1, x * points : (x + 1) * points + 1]
            np.maximum(shared, quarter.weight, out=shared)
    return make_layer(colour, coverage, weight, bands)


def composite(own: Layer | None, finer: Layer | None) -> Layer | None:
    """A displayed tile: the finer image over its own, fading in from the finer frames' borders."""
    if own is None or finer is None:
        return finer if own is None else own
    return mix(own, finer, np.minimum(finer.weight / FEATHER, 1))


def _shrunk_bands(bands: Bands, coverage: Coverage | None) -> Bands:
    """Mean of each 2 x 2 pixels over covered ones (None: all), as for colours."""
    half = len(bands) // 2, len(bands) // 2
    if coverage is None:
        return resized(bands, half)
    share = coverage.astype(np.float32)[..., None]
    mean = resized(bands * share, half) / np.maximum(resized(share, half), 1)
    return np.asarray(np.rint(mean), dtype=bands.dtype)


def _halved(picture: AnyImage) -> AnyImage:
    size = picture.shape[1] // 2, picture.shape[0] // 2
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA))
