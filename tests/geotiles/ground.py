"""An island whose ground is known everywhere, and its canvas' tiles without a file."""

from __future__ import annotations

import math
from functools import lru_cache

import cv2
import numpy as np

from gcs_mosaic.geo.anchor import Anchor
from gcs_mosaic.geo.ellipsoid import LocalPlane
from gcs_mosaic.geotiles.canvas_tiles import CanvasTiles
from gcs_mosaic.geotiles.earth_islands import EarthIsland
from gcs_mosaic.geotiles.pyramid import GeoPyramid
from gcs_mosaic.render.tile_grid import TILE_SIZE, Box, Tile, level_from_canvas, pixel_size
from gcs_mosaic.stitch.arrays import AnyImage, Array, ImageBGRA
from tests.tile_parts import pixel_centres

SURE = ((1e-12, 0.0, 0.0, 0.0), (0.0, 1e-12, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0))


def anchor(
    *, gsd_m: float = 0.1, turned_deg: float = 30.0, longitude: float = 7.0, latitude: float = 44.5, middle: complex = 0
) -> Anchor:
    """The canvas' origin lies at `middle` metres (east, north) of a place; `turned_deg`: counterclockwise."""
    turn = gsd_m * np.exp(1j * math.radians(turned_deg))
    return Anchor(plane=LocalPlane(longitude, latitude), turn=complex(turn), shift=middle, middle=0j, covariance=SURE)


def island(
    box: Box = (-1000.0, -800.0, 1000.0, 800.0),
    *,
    finest: int = 16,
    id: int = 0,
    frames: int = 9,
    laid: Anchor | None = None,
) -> EarthIsland:
    coarsest = finest
    while coarsest > 0 and max(box[2] - box[0], box[3] - box[1]) > 256 * 2.0 ** (16 - coarsest):
        coarsest -= 1
    return EarthIsland(id, frames, box, coarsest, finest, laid or anchor())


def waves(places: Array, longest: float = 400.0, pixel: float = 0.0) -> Array:
    """(..., 3) grey levels from 60 to 200, other for each place and colour; their mean over squares of `pixel` units."""
    parts = []
    for a, b, phase in ((1.0, 0.7, 0.1), (0.6, 1.1, 1.3), (0.8, 0.5, 2.1)):
        x, y = 2 * np.pi * a / longest, 2 * np.pi * b / longest
        faded = np.sinc(a * pixel / longest) * np.sinc(b * pixel / longest)
        parts.append(faded * np.sin(x * places[..., 0] + phase) * np.cos(y * places[..., 1] - phase))
    return 130 + 70 * np.stack(parts, axis=-1)


def painted(longest: float = 400.0) -> CanvasTiles:
    """Tiles that show the waves within the island's box: means over their pixels, covered as far as the box covers them."""

    @lru_cache(256)
    def tile(one: EarthIsland, wanted: Tile) -> ImageBGRA | None:
        left, top, right, bottom = one.box
        places, pixel = pixel_centres(wanted), pixel_size(wanted.z)
        across, down = (
            np.clip((np.minimum(at + pixel / 2, high) - np.maximum(at - pixel / 2, low)) / pixel, 0, 1)
            for at, low, high in ((places[0, :, 0], left, right), (places[:, 0, 1], top, bottom))
        )
        covered = down[:, None] * across
        if not covered.any():
            return None
        inside = np.clip(places, (left, top), (right, bottom))
        return np.rint(np.dstack([waves(inside, longest, pixel) * covered[..., None], 255 * covered])).astype(np.uint8)

    return tile


def noisy(contrast: float = 80.0, seed: int = 1) -> CanvasTiles:
    """Tiles of independent noise at the island's finest level, and of its means at coarser ones."""
    chance = np.random.default_rng(seed)
    fine: dict[Tile, AnyImage] = {}

    @lru_cache(1024)
    def tile(one: EarthIsland, wanted: Tile) -> ImageBGRA | None:
        low, high = level_from_canvas(wanted.z, np.array(one.box).reshape(2, 2)) / TILE_SIZE
        if not ((high > wanted[1:]).all() and (low < np.array(wanted[1:]) + 1).all()):
            return None
        if wanted.z >= one.finest:
            grey = chance.normal(128, contrast / 2, (TILE_SIZE, TILE_SIZE, 3)).clip(0, 255).astype(np.uint8)
            return fine.setdefault(wanted, np.dstack([grey, np.full((TILE_SIZE, TILE_SIZE), 255, np.uint8)]))
        empty = np.zeros((TILE_SIZE, TILE_SIZE, 4), np.uint8)
        children = [found if (found := tile(one, child)) is not None else empty for child in wanted.children]
        whole = np.vstack([np.hstack(children[:2]), np.hstack(children[2:])])
        return np.asarray(cv2.resize(whole, (TILE_SIZE, TILE_SIZE), interpolation=cv2.INTER_AREA), dtype=np.uint8)

    return tile


def pyramid(*islands: EarthIsland, longest: float = 400.0) -> GeoPyramid:
    return GeoPyramid(islands or (island(),), painted(longest))
