"""Hole filling: a tile's holes are filled from coarser tiles, with the finer image fading into the coarser one.

A tile holds only what was seen at its level. Tiles on disk may change or vanish while being read; a missing, truncated or
invalid tile counts as unseen.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Protocol

import cv2
import numpy as np

from gcs_mosaic.render.pyramid import TilePicture
from gcs_mosaic.render.tile_cache import full_coverage
from gcs_mosaic.render.tile_grid import TILE_SIZE, Tile, ancestor
from gcs_mosaic.stitch.arrays import AnyImage, Bands, Coverage, FloatImage, Mask, Matrix2x3
from gcs_mosaic.store.tiles import ReadMask, read_mask, read_tile

DEEPEST = 8  # levels between a tile and the ancestor it is filled from: there one pixel fills it
FADE = 24  # px from the edge of the finer image to where it is opaque


class Tiles(Protocol):
    """The tiles of one island, from any source."""

    def picture(self, tile: Tile) -> TilePicture | None:
        """A displayed tile; None if empty."""

    def mask(self, tile: Tile) -> Coverage | None:
        """Its coverage, `full_coverage(256)` itself if full; None if there is no tile."""


@dataclass(frozen=True, slots=True)
class WrittenTiles:
    """The tiles of an island in a flight's folder. `masks`: whoever fills many tiles may know masks that were read before."""

    root: Path
    island: int
    masks: ReadMask = read_mask

    def picture(self, tile: Tile) -> TilePicture | None:
        return read_tile(self.root, self.island, tile, self.masks)

    def mask(self, tile: Tile) -> Coverage | None:
        return self.masks(self.root, self.island, tile)


class _ReadOnce:
    """Tiles, of which each is read, and its fading found, once for all that one is filled from."""

    def __init__(self, tiles: Tiles) -> None:
        self.picture, self.mask = cache(tiles.picture), cache(tiles.mask)
        self._fades: dict[Tile, FloatImage | None] = {}

    def fade(self, tile: Tile) -> FloatImage | None:
        if tile not in self._fades:
            self._fades[tile] = fade(self, tile)
        return self._fades[tile]


def filled_picture(tiles: Tiles, tile: Tile) -> TilePicture | None:
    """A tile with its holes filled from the nearest non-empty ancestors; None if all are empty."""
    once = _ReadOnce(tiles)
    shown: TilePicture | None = None
    for level, picture in reversed(_layers(once, tile)):
        shown = picture if shown is None else _over(picture, shown, _opacity(once, tile, level))
    return shown if shown is not None and shown.coverage.any() else None


def fade(tiles: Tiles, tile: Tile) -> FloatImage | None:
    """Opacity of a tile towards places seen only at a coarser level, including its neighbours': 0 there, 1 from `FADE` px on;
    None if 1 everywhere."""
    around = [Tile(tile.z, tile.x + dx, tile.y + dy) for dx in (-1, 0, 1) for dy in (-1, 0, 1)]
    covered = [tiles.mask(near) for near in around]
    if all(mask is full_coverage(TILE_SIZE) for mask in covered):
        return None
    ends = _nine([_known_coarser_only(tiles, near, mask) for near, mask in zip(around, covered, strict=True)])
    if not ends.any():
        return None
    distance = cv2.distanceTransform((~ends).astype(np.uint8), cv2.DIST_L2, 3)[FADE:-FADE, FADE:-FADE]
    return np.asarray(np.minimum(distance / FADE, 1), dtype=np.float32)


def _layers(tiles: _ReadOnce, tile: Tile) -> list[tuple[int, TilePicture]]:
    """The tile and the ancestors needed to fill it, enlarged to its size; finest first."""
    layers: list[tuple[int, TilePicture]] = []
    is_open = np.ones((TILE_SIZE, TILE_SIZE), dtype=bool)  # what is not yet covered by something opaque
    for level in range(tile.z, max(tile.z - DEEPEST, 0) - 1, -1):
        if level < tile.z and not _shows_more(tiles, tile, level, is_open):
            continue
        picture = tiles.picture(ancestor(tile, level))
        if picture is None:
            continue
        shown = picture if level == tile.z else _enlarged(picture, tile, level)
        layers.append((level, shown))
        opacity = _opacity(tiles, tile, level)
        is_open &= (shown.coverage < 255) if opacity is None else (shown.coverage < 255) | (opacity < 1)
        if not is_open.any():
            break
    return layers


def _shows_more(tiles: _ReadOnce, tile: Tile, level: int, is_open: Mask) -> bool:
    """Whether an ancestor covers something of what is open; its mask is read faster than its picture."""
    mask = tiles.mask(ancestor(tile, level))
    if mask is None or mask is full_coverage(TILE_SIZE):
        return mask is not None
    return bool((_whole(mask, coarse_from_tile(tile, level)) & is_open).any())


def _opacity(tiles: _ReadOnce, tile: Tile, level: int) -> FloatImage | None:
    at_level = tiles.fade(ancestor(tile, level))
    if at_level is None or level == tile.z:
        return at_level
    return _resampled(at_level, coarse_from_tile(tile, level))


def _known_coarser_only(tiles: Tiles, tile: Tile, mask: Coverage | None) -> Mask:
    """Where a tile has a hole that one of the two levels above does not have."""
    holes = np.ones((TILE_SIZE, TILE_SIZE), dtype=bool) if mask is None else mask == 0
    coarser = np.zeros((TILE_SIZE, TILE_SIZE), dtype=bool)
    for level in range(max(tile.z - 2, 0), tile.z if holes.any() else 0):
        above = tiles.mask(ancestor(tile, level))
        if above is not None:
            # Only fully covered pixels: at the map's outer border coarser pixels always extend a little farther.
            whole = (above == 255).astype(np.uint8)
            coarser |= _resampled(whole, coarse_from_tile(tile, level), cv2.INTER_NEAREST) > 0
    return holes & coarser


def _nine(parts: list[Mask]) -> Mask:
    """Nine tiles, in column order, joined and cropped to the middle one with `FADE` px around it."""
    whole = np.hstack([np.vstack(parts[i : i + 3]) for i in (0, 3, 6)])
    cut = slice(TILE_SIZE - FADE, 2 * TILE_SIZE + FADE)
    return whole[cut, cut]


def _enlarged(coarse: TilePicture, tile: Tile, level: int) -> TilePicture:
    """The part of an ancestor's image that a tile covers, at the tile's size."""
    place = coarse_from_tile(tile, level)
    if coarse.coverage is full_coverage(TILE_SIZE):
        whole, coverage = None, coarse.coverage
    else:
        whole = _whole(coarse.coverage, place)
        coverage = np.where(whole, 255, 0).astype(np.uint8)

    def enlarged(bands: Bands) -> Bands:
        wide = _resampled(bands, place)
        return wide if whole is None else np.where(whole[..., None], wide, 0).astype(bands.dtype)

    return TilePicture(enlarged(coarse.colour), coverage, None if coarse.bands is None else enlarged(coarse.bands))


def _whole(coverage: Coverage, coarse_from_fine: Matrix2x3) -> Mask:
    """Where a coarse tile covers a finer one; only by fully covered pixels: at the map's outer border coarser ones extend farther
    than the ground seen."""
    return np.asarray(_resampled((coverage == 255).astype(np.float32), coarse_from_fine) > 0.999)


def coarse_from_tile(tile: Tile, level: int) -> Matrix2x3:
    """Pixels of the ancestor at a level from pixels of a tile (2x3); integer coordinates are pixel centres, as in OpenCV."""
    up = 1 << (tile.z - level)
    x, y = ((i % up) * TILE_SIZE / up + 0.5 / up - 0.5 for i in (tile.x, tile.y))
    return np.array([[1 / up, 0, x], [0, 1 / up, y]])


def _resampled(image: AnyImage, source_from_target: Matrix2x3, interpolation: int = cv2.INTER_LINEAR) -> AnyImage:
    """An image (h, w[, bands]) resampled to a tile, of the same type."""
    flags = interpolation | cv2.WARP_INVERSE_MAP
    size = TILE_SIZE, TILE_SIZE
    if image.ndim == 3 and image.shape[2] not in (3, 4):
        bands = (np.ascontiguousarray(image[..., band]) for band in range(image.shape[2]))
        return np.stack([_resampled(band, source_from_target, interpolation) for band in bands], axis=-1)
    return np.asarray(cv2.warpAffine(image, source_from_target, size, flags=flags, borderMode=cv2.BORDER_REPLICATE))


def _over(picture: TilePicture, below: TilePicture, opacity: FloatImage | None) -> TilePicture:
    """An image over another: opaque where it alone covers, else with its coverage limited by `opacity`."""
    share = picture.coverage / np.float32(255)
    share = share if opacity is None else np.minimum(share, opacity)
    share = np.where(below.coverage == 0, np.float32(1), share)[..., None]

    def mixed(upper: Bands, lower: Bands) -> Bands:
        return np.rint(upper * share + lower * (1 - share)).astype(upper.dtype)

    both = picture.bands is not None and below.bands is not None
    bands = mixed(picture.bands, below.bands) if both else None  # type: ignore[arg-type]
    return TilePicture(mixed(picture.colour, below.colour), np.maximum(picture.coverage, below.coverage), bands)
