"""Warping a frame's pixels to a tile."""

from __future__ import annotations

import math
import threading

import cv2
import numpy as np

from gcs_mosaic.render.tile_grid import TILE_SIZE, Tile
from gcs_mosaic.render.warp_grid import LATTICE, LATTICE_STEP, FrameLattice
from gcs_mosaic.stitch.arrays import Bands, Coverage, ImageBGR, Lattice

NOWHERE = -1e4  # px; outside every frame, and within the fixed-point range of cv2.remap

AT_ONCE = 4  # bands per call of cv2.remap


class _Scratch(threading.local):
    """Half a megabyte of buffers; allocating and freeing them twice per tile would double the cost."""

    def __init__(self) -> None:
        side = LATTICE * LATTICE_STEP
        self.one = np.empty((side, side), np.float32)
        self.two = np.empty((side, side, 2), np.float32)


_scratch = _Scratch()


def upscale(values: Lattice) -> Lattice:
    """Values at a tile's lattice points (17, 17[, 2]), or at points twice as dense (33, 33[, k]), bilinear at its pixel centres
    (256, 256[, k]).

    The result is overwritten by this thread's next call for lattice points with the same number of channels.
    """
    step = TILE_SIZE // (len(values) - 1)
    size, rim = len(values) * step, step // 2
    known = {(): _scratch.one, (2,): _scratch.two} if step == LATTICE_STEP else {}
    scratch = known.get(values.shape[2:])
    wide = np.asarray(cv2.resize(values, (size, size), dst=scratch, interpolation=cv2.INTER_LINEAR), dtype=np.float32)
    return wide.reshape(size, size, *values.shape[2:])[rim:-rim, rim:-rim]


def refined(values: Lattice) -> Lattice:
    """Values at lattice points (n, m[, k]) with the means of neighbours in between, (2 n - 1, 2 m - 1[, k])."""
    rows, columns = values.shape[:2]
    fine = np.empty((2 * rows - 1, 2 * columns - 1, *values.shape[2:]), np.float32)
    fine[::2, ::2] = values
    half = values * np.float32(0.5)
    np.add(half[:-1], half[1:], out=fine[1::2, ::2])
    half = fine[:, ::2] * np.float32(0.5)
    np.add(half[:, :-1], half[:, 1:], out=fine[:, 1::2])
    return fine


def shrunk(image: ImageBGR, pixels: int) -> ImageBGR:
    """The image (h, w, 3) reduced to about so many pixels by area averaging; unchanged if it has no more."""
    shrink = math.sqrt(pixels / (image.shape[0] * image.shape[1]))
    if shrink >= 1:
        return image
    size = max(1, round(image.shape[1] * shrink)), max(1, round(image.shape[0] * shrink))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def tile_picture(
    lattice: FrameLattice, image: Bands, tile: Tile, interpolation: int, place: tuple[slice, slice] = np.s_[:, :]
) -> tuple[Bands, Coverage | None]:
    """A frame's part of a tile, or of some rows and columns of it: its bands (h, w, bands), 0 where uncovered, and coverage (h,
    w), 0 or 255, None if full. `image` (h, w, bands) may be uint8 or uint16; `interpolation` is an OpenCV flag."""
    window = lattice.window(tile)
    pixels = upscale(lattice.pixels[window])[place]
    coverage = _coverage(lattice, pixels, window, place)
    if coverage is None:
        return warped(image, pixels, interpolation), None
    if np.isnan(lattice.pixels[window]).any():
        pixels = np.nan_to_num(pixels, nan=NOWHERE)
    return _masked(warped(image, pixels, interpolation), coverage), coverage


def _coverage(
    lattice: FrameLattice, pixels: Lattice, window: tuple[slice, slice], place: tuple[slice, slice]
) -> Coverage | None:
    if _well_inside(lattice, window):
        return None
    coverage = cv2.inRange(pixels, *lattice.limits)
    if lattice.useful is not None:
        coverage[~(upscale(lattice.useful[window])[place] > 0)] = 0
    return None if coverage.all() else np.asarray(coverage, dtype=np.uint8)


def _well_inside(lattice: FrameLattice, window: tuple[slice, slice]) -> bool:
    """Whether a whole tile is painted, from its lattice points (bilinear values lie between those)."""
    least, most = lattice.limits
    corners = lattice.pixels[window]
    within = bool(((corners > least) & (corners < most)).all())
    return within and (lattice.useful is None or bool((lattice.useful[window] > 0).all()))


def warped(image: Bands, pixels: Lattice, interpolation: int) -> Bands:
    """An image (h, w, bands) at pixels (r, c, 2): (r, c, bands), with the same places and weights for all bands."""
    # Replicated, not black, beyond the border: the outermost half pixel belongs to the frame.
    if image.shape[2] in (3, 4):
        return cv2.remap(image, pixels, None, interpolation, borderMode=cv2.BORDER_REPLICATE)  # type: ignore
    out = np.empty((*pixels.shape[:2], image.shape[2]), image.dtype)
    for first in range(0, image.shape[2], AT_ONCE):
        group = np.ascontiguousarray(image[..., first : first + AT_ONCE])
        warped = cv2.remap(group, pixels, None, interpolation, borderMode=cv2.BORDER_REPLICATE)  # type: ignore
        out[..., first : first + AT_ONCE] = warped.reshape(*pixels.shape[:2], -1)
    return out


def _masked(bands: Bands, coverage: Coverage) -> Bands:
    if bands.shape[2] == 3:
        return np.asarray(cv2.copyTo(bands, coverage), dtype=bands.dtype)
    bands[coverage == 0] = 0
    return bands
