"""How the bands of a frame become what a person sees: which of them are shown, a stretch to eight bits, and light in the dark.

All are fixed when the first frame of a kind (number of bands, depth) is painted, and belong to what a tile is a function of:
a map whose brightness followed every new frame could not be painted frame by frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.stitch.camera.bands import Bands

Image = NDArray[np.uint8]

SAMPLE = 200_000  # pixels at most that a stretch is told from
DARK, BRIGHT = 0.005, 0.995  # quantiles; beyond them lie dead pixels, glints and fires
HEADROOM = 0.25  # of the range between them, kept free for what the next frames show: aerial frames are much alike
LEAST_RANGE = 16  # counts; less is the noise of the sensor
MIDDLE = 100.0  # grey levels; a frame whose median is below is dark, and its median is shown like this
# What is darker than these can lighten would come out as noise: eight bits have no more in the dark.
MOST_FACTOR, LEAST_GAMMA = 6.0, 0.4


@dataclass(frozen=True, slots=True)
class Display:
    """`shown`: the bands shown as blue, green and red, counted from 0, one band three times for grey; `black`, `white`: of each
    band of the frame (shown or not), the counts that become 0 and 255; a level from 0 to 1, times
    `factor` and then to the power of `gamma`, is what is shown in the end; nothing else is done with that."""

    shown: tuple[int, int, int] = (0, 1, 2)
    black: tuple[int, ...] = (0, 0, 0)
    white: tuple[int, ...] = (255, 255, 255)
    factor: float = 1.0
    gamma: float = 1.0

    @property
    def is_plain(self) -> bool:
        """Whether frames are pictures in eight-bit colour that need no stretch."""
        return (self.shown, self.black, self.white) == (PLAIN.shown, PLAIN.black, PLAIN.white)

    def fits(self, image: Bands) -> bool:
        """Whether the image (h, w, bands) has as many bands as this tells of."""
        return image.ndim == 3 and image.shape[2] == len(self.black)

    def picture(self, image: Bands) -> Image:
        """(h, w, 3) BGR of a frame (h, w, bands), before `lightened`; the frame itself if it is such a picture already."""
        if self.is_plain and image.dtype == np.uint8:
            return image
        chosen = {band: self._level(np.ascontiguousarray(image[..., band]), band) for band in set(self.shown)}
        return np.asarray(cv2.merge([chosen[band] for band in self.shown]), dtype=np.uint8)

    def gained(self, image: Bands, gain: tuple[float, ...]) -> Bands:
        """All bands (h, w, bands) with the gain of each applied to what it has above black, at their own depth."""
        most = np.iinfo(image.dtype).max
        counts = np.arange(most + 1, dtype=np.float64)
        tables = [np.clip(np.rint(b + g * (counts - b)), 0, most) for b, g in zip(self.black, gain, strict=True)]
        bands = [table.astype(image.dtype)[image[..., band]] for band, table in enumerate(tables)]
        return np.stack(bands, axis=-1)

    def times(self, image: Bands, factor: NDArray[np.float32]) -> Bands:
        """All bands (h, w, bands) with what they have above black times a factor (h, w, bands), at their own depth."""
        black = np.array(self.black, np.float32)
        counts = black + (image - black) * factor
        return np.clip(np.rint(counts), 0, np.iinfo(image.dtype).max).astype(image.dtype)

    def of_shown(self, gain: tuple[float, ...]) -> tuple[float, float, float]:
        """What is said of each band, for what is shown as blue, green and red."""
        blue, green, red = self.shown
        return gain[blue], gain[green], gain[red]

    def levels(self, image: Bands) -> NDArray[np.uint8] | NDArray[np.float32]:
        """All bands (h, w, bands) in grey levels, not rounded and not clipped: 0 is black, 255 white."""
        if self.is_plain and image.dtype == np.uint8:
            return image
        black, white = np.array(self.black, np.float32), np.array(self.white, np.float32)
        return np.asarray((image.astype(np.float32) - black) * (255 / (white - black)), dtype=np.float32)

    def lightened(self, picture: Image) -> Image:
        """A picture (h, w, 3) as it is shown in the end."""
        if (self.factor, self.gamma) == (1, 1):
            return picture
        return np.asarray(cv2.LUT(picture, _table(self.factor, self.gamma)), np.uint8)

    def _level(self, band: Bands, number: int) -> Image:
        if (self.black[number], self.white[number]) == (0, 255) and band.dtype == np.uint8:
            return band
        counts = np.arange(np.iinfo(band.dtype).max + 1, dtype=np.float64)
        scaled = (counts - self.black[number]) * (255 / (self.white[number] - self.black[number]))
        return np.asarray(np.clip(np.rint(scaled), 0, 255).astype(np.uint8)[band])


PLAIN = Display()  # of a picture in eight-bit colour, which is shown as it is


@cache
def _table(factor: float, gamma: float) -> Image:
    return np.rint(255 * np.minimum(factor * np.linspace(0, 1, 256), 1) ** gamma).astype(np.uint8)


def display_of(image: Bands, chosen: Sequence[int] = (), *, lighten: bool = False) -> Display:
    """How frames of this one's kind are shown. Eight bits are not stretched. Three bands are a picture in colour and keep their
    balance. Of others `chosen` are shown: one band, or three as red, green and blue, counted from 1. Without it, or if the frame
    has no such bands: the first three as blue, green and red (the order of the spectrum, in which multispectral cameras have
    them), of one or two the first. `lighten`: if this one is dark, its median becomes a middle grey; nothing is made darker.
    """
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


def _light(picture: Image) -> tuple[float, float]:
    """The factor and gamma that show the median of a dark picture (h, w, 3) as MIDDLE. The factor is what its lights leave room
    for, with headroom, as far as it is needed; gamma does the rest, and makes lights no brighter."""
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


def _stretch(band: Bands) -> tuple[int, int]:
    """Black and white of one band. Black is the sensor's zero unless the counts stand far above it, as those of a thermal
    camera do: then most of the range would show nothing."""
    if band.dtype == np.uint8:
        return 0, 255
    dark, bright = np.quantile(_sample(band), (DARK, BRIGHT)).tolist()
    room = HEADROOM * max(bright - dark, LEAST_RANGE)
    black = 0 if dark < 2 * (bright - dark) else max(0, round(dark - room))
    return black, max(round(bright + room), black + LEAST_RANGE)
