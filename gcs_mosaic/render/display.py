"""How the bands of a frame are displayed: band selection, stretch to 8 bit, and brightening of dark flights.

All are fixed when the first frame of a kind (number of bands, depth) is painted, and are inputs of every tile: a map whose
brightness followed every new frame could not be painted incrementally.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import cv2
import numpy as np

from gcs_mosaic.stitch.arrays import Band, Bands, FloatImage, ImageBGR, ImageGrey, Levels, LookupTable

SAMPLE = 200_000  # maximum number of pixels sampled for a stretch
DARK, BRIGHT = 0.005, 0.995  # quantiles; beyond them are dead pixels, glints and fires
HEADROOM = 0.25  # of the range between them, reserved for later frames: aerial frames are similar to each other
LEAST_RANGE = 16  # counts; less is sensor noise
MIDDLE = 100.0  # grey levels; a frame with a lower median is dark, and its median is mapped to this
# Beyond these limits noise would show: 8 bits have no more precision in the dark.
MOST_FACTOR, LEAST_GAMMA = 6.0, 0.4


@dataclass(frozen=True, slots=True)
class Display:
    """Parameters of a display. `shown`: the bands displayed as blue, green and red, counted from 0, one band three times for
    grey; `black`, `white`: for each band of the frame (displayed or not), the counts mapped to 0 and 255; finally a level from
    0 to 1 is multiplied by `factor` and raised to the power of `gamma`, for display only."""

    shown: tuple[int, int, int] = (0, 1, 2)
    black: tuple[int, ...] = (0, 0, 0)
    white: tuple[int, ...] = (255, 255, 255)
    factor: float = 1.0
    gamma: float = 1.0

    @property
    def is_plain(self) -> bool:
        """Whether frames are 8-bit colour images that need no stretch."""
        return (self.shown, self.black, self.white) == (PLAIN.shown, PLAIN.black, PLAIN.white)

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
        """All bands (h, w, bands) with their gains applied above black, at their own depth."""
        most = np.iinfo(image.dtype).max
        counts = np.arange(most + 1, dtype=np.float64)
        tables = [np.clip(np.rint(b + g * (counts - b)), 0, most) for b, g in zip(self.black, gain, strict=True)]
        bands = [table.astype(image.dtype)[image[..., band]] for band, table in enumerate(tables)]
        return np.stack(bands, axis=-1)

    def times(self, image: Bands, factor: FloatImage) -> Bands:
        """All bands (h, w, bands) with a factor (h, w, bands) applied above black, at their own depth."""
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
        black, white = np.array(self.black, np.float32), np.array(self.white, np.float32)
        return np.asarray((image.astype(np.float32) - black) * (255 / (white - black)), dtype=np.float32)

    def lightened(self, picture: ImageBGR) -> ImageBGR:
        """An image (h, w, 3) with the final brightening."""
        if (self.factor, self.gamma) == (1, 1):
            return picture
        return np.asarray(cv2.LUT(picture, _table(self.factor, self.gamma)), np.uint8)

    def _level(self, band: Band, number: int) -> ImageGrey:
        if (self.black[number], self.white[number]) == (0, 255) and band.dtype == np.uint8:
            return band
        counts = np.arange(np.iinfo(band.dtype).max + 1, dtype=np.float64)
        scaled = (counts - self.black[number]) * (255 / (self.white[number] - self.black[number]))
        return np.asarray(np.clip(np.rint(scaled), 0, 255).astype(np.uint8)[band])


PLAIN = Display()  # of an 8-bit colour image, displayed as it is


@cache
def _table(factor: float, gamma: float) -> LookupTable:
    return np.rint(255 * np.minimum(factor * np.linspace(0, 1, 256), 1) ** gamma).astype(np.uint8)


def display_of(image: Bands, chosen: Sequence[int] = (), *, lighten: bool = False) -> Display:
    """The display of frames of this one's kind. 8-bit images are not stretched. Three bands are a colour image and keep their
    balance. Of others the `chosen` bands are displayed: one, or three as red, green and blue, counted from 1. Without it, or if
    the frame has no such bands: the first three as blue, green and red (multispectral cameras order them by wavelength), with
    one or two bands the first. `lighten`: if this frame is dark, its median is mapped to a middle grey; nothing is darkened."""
    count = image.shape[2]
    stretches = [_stretch(image[..., band]) for band in range(count)]
    black, white = [b for b, _ in stretches], [w for _, w in stretches]
    if count == 3:
        black, white = [min(black)] * 3, [max(white)] * 3
    display = Display(_shown(count, chosen), tuple(black), tuple(white))
    if lighten:
        factor, gamma = _light(display.picture(_sample(image)))
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


def _sample(image: Bands) -> Bands:
    step = max(1, int(np.sqrt(image.shape[0] * image.shape[1] / SAMPLE)))
    return np.ascontiguousarray(image[::step, ::step])


def _shown(count: int, chosen: Sequence[int]) -> tuple[int, int, int]:
    there = count != 3 and all(1 <= band <= count for band in chosen)
    if there and len(chosen) == 3:
        red, green, blue = chosen
        return blue - 1, green - 1, red - 1
    if there and len(chosen) == 1:
        return (chosen[0] - 1,) * 3
    return (0, 1, 2) if count >= 3 else (0, 0, 0)


def _stretch(band: Band) -> tuple[int, int]:
    """Black and white of one band. Black is the sensor's zero unless the counts are far above it, as from thermal cameras: then
    most of the range would be unused."""
    if band.dtype == np.uint8:
        return 0, 255
    dark, bright = np.quantile(_sample(band), (DARK, BRIGHT)).tolist()
    room = HEADROOM * max(bright - dark, LEAST_RANGE)
    black = 0 if dark < 2 * (bright - dark) else max(0, round(dark - room))
    return black, max(round(bright + room), black + LEAST_RANGE)
