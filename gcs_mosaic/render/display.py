"""How the bands of a frame are displayed: band selection, stretch to 8 bit, and brightening of dark flights.

All are inputs of every tile. Of 8-bit frames they are fixed by the first of a kind; the range of counts is that of a camera's
frames, see `counts_range`, and each frame says how its own counts compare to it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import cv2
import numpy as np

from gcs_mosaic.render.counts_range import BRIGHT, HEADROOM, Counts, Knot, Sketch, fitted_range, sample_of, sketch_of
from gcs_mosaic.render.exposure import is_false_colour
from gcs_mosaic.stitch.arrays import Band, Bands, FloatImage, ImageBGR, ImageGrey, Levels, LookupTable

MIDDLE = 100.0  # grey levels; a frame with a lower median is dark, and its median is mapped to this
# Beyond these limits noise would show: 8 bits have no more precision in the dark.
MOST_FACTOR, LEAST_GAMMA = 6.0, 0.4


@dataclass(frozen=True, slots=True)
class Display:
    """Parameters of a display. `shown`: the bands displayed as blue, green and red, counted from 0, one band three times for
    grey; `black`, `white`: for each band of the frame (displayed or not), the counts mapped to 0 and 255, and `knots`: further
    (count, level) between them, linear between these; finally a level from 0 to 1 is multiplied by `factor` and raised to the
    power of `gamma`, for display only. These counts are those of the camera at its usual gain; a frame's own become these if
    they are multiplied by `scale` and added to `offset`, by band. Empty: as they are, and no knots."""

    shown: tuple[int, int, int] = (0, 1, 2)
    black: tuple[int, ...] = (0, 0, 0)
    white: tuple[int, ...] = (255, 255, 255)
    factor: float = 1.0
    gamma: float = 1.0
    knots: tuple[tuple[Knot, ...], ...] = ()
    scale: tuple[float, ...] = ()
    offset: tuple[float, ...] = ()

    @property
    def is_plain(self) -> bool:
        """Whether frames are 8-bit colour images that need no stretch."""
        return (self.shown, self.black, self.white) == (PLAIN.shown, PLAIN.black, PLAIN.white)

    @property
    def of_camera(self) -> Display:
        """That of the camera's frames at its usual gain."""
        return replace(self, scale=(), offset=())

    @property
    def kind(self) -> tuple[int, bool]:
        """Number of bands, and whether they have 8 bits: what frames of one kind have in common."""
        return len(self.black), not any(self.black) and set(self.white) == {255}

    def fits(self, image: Bands) -> bool:
        """Whether the image (h, w, bands) has the expected number of bands."""
        return image.ndim == 3 and image.shape[2] == len(self.black)

    def picture(self, image: Bands) -> ImageBGR:
        """BGR image (h, w, 3) of a frame (h, w, bands), before `lightened`; the frame itself if it is one already."""
        if self.is_plain and image.dtype == np.uint8:
            return image
        chosen = {band: self._level(np.ascontiguousarray(image[..., band]), band) for band in set(self.shown)}
        return np.asarray(cv2.merge([chosen[band] for band in self.shown]), dtype=np.uint8)

    def gained(self, image: Bands, gain: tuple[float, ...]) -> Bands:
        """All bands (h, w, bands) as counts at the camera's usual gain, their gains applied above black, at their own depth."""
        most = np.iinfo(image.dtype).max
        every = np.arange(most + 1, dtype=np.float64)
        counts = [self._usual(every, band) for band in range(len(self.black))]
        tables = [np.clip(np.rint(b + g * (c - b)), 0, most) for b, g, c in zip(self.black, gain, counts, strict=True)]
        bands = [table.astype(image.dtype)[image[..., band]] for band, table in enumerate(tables)]
        return np.stack(bands, axis=-1)

    def times(self, image: Bands, factor: FloatImage) -> Bands:
        """What `gained` gives (h, w, bands), with a factor (h, w, bands) applied above black, at its own depth."""
        black = np.array(self.black, np.float32)
        counts = black + (image - black) * factor
        return np.clip(np.rint(counts), 0, np.iinfo(image.dtype).max).astype(image.dtype)

    def of_shown(self, gain: tuple[float, ...]) -> tuple[float, float, float]:
        """Values given by band, for the bands displayed as blue, green and red."""
        blue, green, red = self.shown
        return gain[blue], gain[green], gain[red]

    def levels(self, image: Bands) -> Levels:
        """All bands (h, w, bands) in grey levels, neither rounded nor clipped: 0 is black, 255 white."""
        if self.is_plain and image.dtype == np.uint8:
            return image
        bands = [self._levels_of(image[..., band].astype(np.float32), band) for band in range(len(self.black))]
        return np.stack(bands, axis=-1).astype(np.float32)

    def lightened(self, picture: ImageBGR) -> ImageBGR:
        """An image (h, w, 3) with the final brightening."""
        if (self.factor, self.gamma) == (1, 1):
            return picture
        return np.asarray(cv2.LUT(picture, _table(self.factor, self.gamma)), np.uint8)

    def _level(self, band: Band, number: int) -> ImageGrey:
        if (self.black[number], self.white[number]) == (0, 255) and band.dtype == np.uint8:
            return band
        levels = self._levels_of(np.arange(np.iinfo(band.dtype).max + 1, dtype=np.float64), number)
        return np.asarray(np.clip(np.rint(levels), 0, 255).astype(np.uint8)[band])

    def _usual(self, counts: Counts, band: int) -> Counts:
        """A frame's counts as those of the camera at its usual gain."""
        return counts * self.scale[band] + self.offset[band] if self.scale else counts

    def _levels_of(self, counts: Counts, band: int) -> Counts:
        black, white = self.black[band], self.white[band]
        usual = self._usual(counts, band)
        if not self.knots or not self.knots[band]:
            return np.asarray((usual - black) * (255 / (white - black)))
        at, levels = zip((black, 0.0), *self.knots[band], (white, 255.0), strict=True)
        inside = np.interp(usual, at, levels)
        below = (usual - black).clip(max=0) * (levels[1] / (at[1] - black))
        above = (usual - white).clip(min=0) * ((255 - levels[-2]) / (white - at[-2]))
        return np.asarray(inside + below + above)


PLAIN = Display()  # of an 8-bit colour image, displayed as it is


@cache
def _table(factor: float, gamma: float) -> LookupTable:
    return np.rint(255 * np.minimum(factor * np.linspace(0, 1, 256), 1) ** gamma).astype(np.uint8)


def display_of(image: Bands, chosen: Sequence[int] = (), *, lighten: bool = False) -> Display:
    """The display of frames of this one's kind. Three bands are a colour image and keep their balance. Of others the `chosen`
    bands are displayed: one, or three as red, green and blue, counted from 1. Without it, or if the frame has no such bands: the
    first three as blue, green and red (multispectral cameras order them by wavelength), with one or two bands the first.

    8-bit images are not stretched; the range of others is that of this one alone.
    `lighten`: if this frame is dark, its median is mapped to a middle grey; nothing is darkened."""
    black, white, knots = fitted_range([] if image.dtype == np.uint8 else [sketch_of(image)], image.shape[2])
    display = Display(_shown(image.shape[2], chosen), black, white, knots=knots)
    picture = display.picture(sample_of(image)) if lighten else None
    if picture is not None and not is_false_colour(picture):  # a palette's colours mean something
        factor, gamma = _light(picture)
        display = replace(display, factor=factor, gamma=gamma)
    return display


def camera_display(sketches: Sequence[Sketch], chosen: Sequence[int] = (), *, lighten: bool = False) -> Display:
    """As `display_of`, of all frames of a camera of counts by their sketches, at its usual gain."""
    count = len(sketches[0])
    black, white, knots = fitted_range(sketches, count)
    display = Display(_shown(count, chosen), black, white, knots=knots)
    if lighten:
        seen = np.moveaxis(np.array(sketches), 1, 2)  # (frames, shares, bands)
        picture = np.clip(display.levels(seen)[..., display.shown], 0, 255)
        factor, gamma = _light(np.rint(picture).astype(np.uint8))
        display = replace(display, factor=factor, gamma=gamma)
    return display


def _light(picture: ImageBGR) -> tuple[float, float]:
    """Factor and gamma that map the median of a dark image (h, w, 3) to MIDDLE. The factor uses the headroom above the highlights
    as far as needed; gamma does the rest without brightening the highlights."""
    median = max(float(np.median(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY))), 1.0)
    if median >= MIDDLE:
        return 1.0, 1.0
    room = 255 / (1 + HEADROOM) / max(float(np.quantile(picture, BRIGHT)), 1.0)
    factor = round(float(np.clip(room, 1, min(MIDDLE / median, MOST_FACTOR))), 3)
    gamma = np.log(MIDDLE / 255) / np.log(median * factor / 255)
    return factor, round(float(np.clip(gamma, LEAST_GAMMA, 1)), 3)


def _shown(count: int, chosen: Sequence[int]) -> tuple[int, int, int]:
    there = count != 3 and all(1 <= band <= count for band in chosen)
    if there and len(chosen) == 3:
        red, green, blue = chosen
        return blue - 1, green - 1, red - 1
    if there and len(chosen) == 1:
        return (chosen[0] - 1,) * 3
    return (0, 1, 2) if count >= 3 else (0, 0, 0)
