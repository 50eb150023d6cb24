"""Pixels of a tile from the frames that show on it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import cv2
import numpy as np

from gcs_mosaic.render.blending import blended, blended_bands
from gcs_mosaic.render.cells import CELL
from gcs_mosaic.render.exposure import SHOULDER, WHITE, apply_gain, rolled_off
from gcs_mosaic.render.frame_warp import FrameWarp
from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.render.tile_cache import Layer, make_layer
from gcs_mosaic.render.tile_grid import TILE_SIZE, Tile
from gcs_mosaic.render.tone import FINE
from gcs_mosaic.render.warp import tile_picture, upscale
from gcs_mosaic.render.warp_grid import times_each
from gcs_mosaic.stitch.arrays import AnyImage, Bands, Coverage, ImageBGR, Lattice, Mask, Share, ToneShifts
from gcs_mosaic.stitch.camera.picture_area import filled

Place = tuple[slice, slice]

KeepBands = Literal["none", "raw", "gained"]  # frames' bands kept on tiles: none, raw counts, or with gains

WHOLE = slice(0, TILE_SIZE), slice(0, TILE_SIZE)
# Minimum share of a frame wherever it is made: it shows where the frames with larger shares do not cover the tile.
LEAST_SHARE = 1e-3  # of 255
AT_ONCE = 16  # rows of pixels
# A sharp transition takes half a cell, not a whole one: a person on a seam is transparent on fewer pixels.
STEEP = np.clip(2 * np.arange(256) - 127.5, 0, 255).astype(np.uint8)
# Grey levels that all channels exceed where a photograph nears saturation; from WHITE on the true light is not known, and no
# correction makes it grey. Below the ramp a correction goes all the way: the light there was measured.
NEARS_WHITE = 235
# Share of the photograph as it was taken, by its lowest channel.
WHITENESS = np.clip((np.arange(256) - NEARS_WHITE) * (255 / (WHITE - NEARS_WHITE)), 0, 255).astype(np.uint8)


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """A frame's part of a tile: its `share` (34, 34) of the cells of the tile and around, 0 to 255, where all parts add up to
    255; `needed` (34, 34), where it is made; `shift` (3, 18, 18) of its tone on the squares of the tile and around, None if
    zero."""

    share: Share
    needed: Mask
    shift: ToneShifts | None
    sharp: bool = False  # narrowest possible transition between cells

    def at_pixels(self) -> Share:
        """The share (256, 256)."""
        share = enlarged(self.share)
        return np.asarray(cv2.LUT(share, STEEP) if self.sharp else share, np.uint8)

    @property
    def place(self) -> Place:
        """Rows and columns of the tile's pixels where it is made."""
        rows, columns = (np.flatnonzero(self.needed.any(axis=axis)) for axis in (1, 0))
        return _pixels(rows[0], rows[-1]), _pixels(columns[0], columns[-1])


def _pixels(first: int, last: int) -> slice:
    """Pixels influenced by cells of a patch, to half a cell beyond."""
    return slice(max(0, first * CELL - CELL - CELL // 2), min(TILE_SIZE, last * CELL + CELL // 2))


@dataclass(frozen=True, slots=True, eq=False)
class Piece:
    """A frame's pixels on a part of a tile; `coverage` None: full. `weight`: see `warp_grid.FrameLattice`; 0 of an inset, which
    shows on tiles of other frames only as far as they reach."""

    place: Place
    colour: ImageBGR
    coverage: Coverage | None
    bands: Bands | None
    weight: Lattice

    @property
    def nbytes(self) -> int:
        return sum(one.nbytes for one in (self.colour, self.coverage, self.bands) if one is not None)


@dataclass(frozen=True, slots=True, eq=False)
class FramePicture:
    """A frame's image (h, w, 3) before gain and, if kept, all its bands."""

    image: ImageBGR
    bands: Bands | None


def frame_picture(image: Bands, painted: RenderItem, keep: KeepBands) -> FramePicture:
    """`image`: (h, w, bands) uint8 or uint16, ValueError if it does not match the frame's camera and display."""
    size, display = (painted.camera.height, painted.camera.width), painted.display
    if image.shape[:2] != size or not display.fits(image) or image.dtype not in (np.uint8, np.uint16):
        wanted = (*size, len(display.black))
        raise ValueError(f"{painted.name} is {image.shape} {image.dtype}; its camera makes {wanted} uint8 or uint16")
    # So that nothing dead is interpolated into neighbouring pixels.
    alive = filled(image, painted.dead, painted.area)
    return FramePicture(display.picture(alive), None if keep == "none" else alive)


def piece(
    frame: FrameWarp, picture: FramePicture, tile: Tile, part: Part | None, interpolation: int, keep: KeepBands
) -> Piece | None:
    """A frame's part of a tile, or all it has of it (`part` None); None if it has nothing there."""
    place = WHOLE if part is None else part.place
    window = frame.lattice.window(tile)
    colour, coverage = tile_picture(frame.lattice, picture.image, tile, interpolation, place)
    if coverage is not None and not coverage.any():
        return None
    bands = None
    if picture.bands is not None:
        bands = tile_picture(frame.lattice, picture.bands, tile, interpolation, place)[0]
    bright = None if frame.brightening is None else upscale(frame.brightening[window])[place]
    display = frame.painted.display
    gain = display.of_shown(frame.painted.gain)
    shift = (
        None
        if part is None or part.shift is None
        else enlarged(np.moveaxis(part.shift, 0, 2).astype(np.float32) / FINE)[place]
    )
    by = None if bright is None else times_each(_shown(bright, display.shown), gain)
    colour = display.lightened(_lit(colour, gain, by, shift))
    if bands is not None and keep == "gained":
        bands = display.gained(bands, frame.painted.gain)
        bands = bands if bright is None else display.times(bands, bright)
    if coverage is not None:
        colour = np.asarray(cv2.copyTo(colour, coverage), np.uint8)
        if bands is not None:
            bands[coverage == 0] = 0
    weight = frame.lattice.weight[window]
    is_inset = tile.z != frame.painted.level
    return Piece(place, colour, coverage, bands, np.zeros_like(weight) if is_inset else weight.copy())


def _shown(bright: Lattice, shown: tuple[int, int, int]) -> Lattice:
    """Those of the factors (h, w, bands) that are of the bands shown, (h, w, 3)."""
    is_all = shown == (0, 1, 2) and bright.shape[2] == 3
    return bright if is_all else np.ascontiguousarray(bright[..., shown])


def enlarged(patch: AnyImage) -> AnyImage:
    """Values (n + 2, n + 2[, k]) at the centres of a tile's n * n parts and those around, at its pixels (256, 256[, k])."""
    step = TILE_SIZE // (len(patch) - 2)
    wide = cv2.resize(patch, (TILE_SIZE + 2 * step, TILE_SIZE + 2 * step), interpolation=cv2.INTER_LINEAR)
    return np.asarray(wide)[step:-step, step:-step]


def _lit(colour: ImageBGR, gain: tuple[float, float, float], by: Lattice | None, shift: Lattice | None) -> ImageBGR:
    """An image (h, w, 3) times its gains, or a factor (h, w, 3) with them, rolled off, plus a shift (h, w, 3); white stays
    white."""
    if by is None:
        lit: Any = apply_gain(colour, gain)
    else:
        lit = cv2.multiply(colour, by, dtype=cv2.CV_32F)
        most = float(by.max(initial=0))
        if most > 1 and int(colour.max(initial=0)) * most > SHOULDER:  # few tiles
            for top in range(0, len(lit), AT_ONCE):  # within the processor's cache: three times as fast
                rows = slice(top, top + AT_ONCE)
                lit[rows] = rolled_off(lit[rows], by[rows])
    if shift is not None:
        lit = cv2.add(lit, shift, dtype=cv2.CV_8U)
    elif by is not None:
        lit = cv2.convertScaleAbs(lit)
    return with_whites(np.asarray(lit, np.uint8), colour)


def with_whites(lit: ImageBGR, taken: ImageBGR) -> ImageBGR:
    """A corrected image (h, w, 3), not darker than it was `taken` where that is saturated, and less so than corrected where it
    nears saturation."""
    if lit is taken or int(taken.max(initial=0)) <= NEARS_WHITE:
        return lit
    least = cv2.min(cv2.min(cv2.extractChannel(taken, 0), cv2.extractChannel(taken, 1)), cv2.extractChannel(taken, 2))
    share = np.asarray(cv2.LUT(least, WHITENESS), np.uint8)
    return np.maximum(lit, blended(taken, lit, share)) if share.any() else lit


def mixed(parts: Sequence[tuple[Part, Piece]]) -> Layer | None:
    """A tile from its frames' parts, in capture order."""
    if not parts:
        return None
    weight = np.maximum.reduce([made.weight for _, made in parts])
    if len(parts) == 1:
        return alone(parts[0][1], weight)
    if len(parts) == 2 and all(made.coverage is None for _, made in parts) and _in_full(parts):
        return _of_two(parts, weight)
    return _of_many(parts, weight)


def _in_full(parts: Sequence[tuple[Part, Piece]]) -> bool:
    """Whether the parts fill all cells; beyond the map's border they do not."""
    return int(np.add.reduce([part.share for part, _ in parts], dtype=np.uint16).min()) == 255


def alone(made: Piece, weight: Lattice | None = None) -> Layer | None:
    """A piece as a tile."""
    weight = made.weight if weight is None else weight
    if made.place == WHOLE:
        return make_layer(made.colour, made.coverage, weight, made.bands)
    colour, coverage = np.zeros((TILE_SIZE, TILE_SIZE, 3), np.uint8), np.zeros((TILE_SIZE, TILE_SIZE), np.uint8)
    colour[made.place], coverage[made.place] = made.colour, 255 if made.coverage is None else made.coverage
    bands = None
    if made.bands is not None:
        bands = np.zeros((TILE_SIZE, TILE_SIZE, made.bands.shape[2]), made.bands.dtype)
        bands[made.place] = made.bands
    return make_layer(colour, coverage, weight, bands)


def _of_two(parts: Sequence[tuple[Part, Piece]], weight: Lattice) -> Layer | None:
    (_, under), (part, over) = parts
    layer = alone(under, weight)
    assert layer is not None
    share = part.at_pixels()[over.place]
    colour = layer.colour if under.place != WHOLE else layer.colour.copy()
    colour[over.place] = blended(over.colour, colour[over.place], share)
    bands = layer.bands
    if bands is not None and over.bands is not None:
        bands = bands if under.place != WHOLE else bands.copy()
        bands[over.place] = blended_bands(over.bands, bands[over.place], share)
    return make_layer(colour, None, weight, bands)


def _of_many(parts: Sequence[tuple[Part, Piece]], weight: Lattice) -> Layer | None:
    size = TILE_SIZE, TILE_SIZE
    bands = parts[0][1].bands
    total = np.zeros(size, np.float32)
    sums = [np.zeros((*size, 3), np.float32)]
    if bands is not None:
        sums.append(np.zeros((*size, bands.shape[2]), np.float32))
    for part, made in parts:
        share = part.at_pixels()[made.place].astype(np.float32) + np.float32(LEAST_SHARE)
        if made.coverage is not None:
            share[made.coverage == 0] = 0
        total[made.place] += share
        for summed, values in zip(sums, (made.colour, made.bands), strict=False):
            assert values is not None
            summed[made.place] += values * share[..., None]
    mean = [np.rint(summed / np.maximum(total, np.float32(1e-6))[..., None]) for summed in sums]
    coverage = np.where(total > 0, np.uint8(255), np.uint8(0))
    return make_layer(
        mean[0].astype(np.uint8), coverage, weight, None if bands is None else mean[1].astype(bands.dtype)
    )
