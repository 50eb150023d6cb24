"""How rare colours and contrasts are in the whole flight, as far as it is known."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.hints.anomalies import Appearance
from gcs_mosaic.stitch.arrays import Array, FloatImage

SHIFTS = 4, 3, 3  # bits of L, a and b that a bin of colours spans
SIDES = 16, 32, 32
SMOOTH = 0.05, 0.25, 0.4, 0.25, 0.05  # weights of the bins beside one: a colour is about as common as those beside it
FINEST, LARGEST, STEPS = 0.25, 40.0, 160  # contrasts: bins of equal ratio
EACH = 2  # of so many rows and columns pixels are counted


class FlightRarity:
    """Counts over all pictures analysed so far; a value's rarity is -log10 of the share of pixels that are as rare."""

    def __init__(self) -> None:
        self.colours = np.zeros(SIDES)
        self.contrasts = np.zeros(STEPS + 1)
        self._tables: tuple[FloatImage, FloatImage] | None = None

    def add(self, seen: Appearance) -> None:
        """Count a picture's pixels."""
        bins = _colour_bins(seen.lab[::EACH, ::EACH])
        self.colours += np.bincount(bins.ravel(), minlength=self.colours.size).reshape(SIDES)
        steps = _contrast_steps(seen.contrast[::EACH, ::EACH])
        self.contrasts += np.bincount(steps.ravel(), minlength=STEPS + 1)
        self._tables = None

    def of_colours(self, lab: NDArray[Any]) -> FloatImage:
        """Of colours (..., 3) uint8: of a share of the pixels that have them."""
        return np.asarray(self._looked_up()[0][_colour_bins(lab)])

    def of_contrasts(self, contrast: NDArray[Any]) -> FloatImage:
        """Of contrasts (...): of the share of the pixels that have them or greater ones."""
        return np.asarray(self._looked_up()[1][_contrast_steps(contrast)])

    def oddity(self, seen: Appearance) -> FloatImage:
        """Of each pixel (h, w): how rare its colour and its contrast are together."""
        return np.asarray(self.of_colours(seen.lab) + self.of_contrasts(seen.contrast))

    def _looked_up(self) -> tuple[FloatImage, FloatImage]:
        if self._tables is None:
            smooth = _smoothed(self.colours).ravel()
            greater = np.cumsum(self.contrasts[::-1])[::-1]
            self._tables = _rarity(smooth, self.colours.sum()), _rarity(greater, self.contrasts.sum())
        return self._tables


def _smoothed(counts: Array) -> Array:
    """Along each axis; beyond the border are the values at it."""
    for axis, length in enumerate(counts.shape):
        places = np.arange(length)
        beside = [np.clip(places + step - len(SMOOTH) // 2, 0, length - 1) for step in range(len(SMOOTH))]
        counts = sum(weight * counts.take(each, axis) for weight, each in zip(SMOOTH, beside, strict=True))
    return counts


def _rarity(counts: Array, total: float) -> FloatImage:
    return np.asarray(-np.log10((counts + 1) / (total + 1)), np.float32)


def _colour_bins(lab: NDArray[Any]) -> NDArray[np.int32]:
    (lightness, red, yellow), (_, reds, yellows) = SHIFTS, SIDES
    whole = lab.astype(np.int32)
    rows = ((whole[..., 0] >> lightness) * reds) + (whole[..., 1] >> red)
    return np.asarray(rows * yellows + (whole[..., 2] >> yellow), np.int32)


def _contrast_steps(contrast: NDArray[Any]) -> NDArray[np.int32]:
    per_step = np.log(LARGEST / FINEST) / STEPS
    steps = np.log(np.maximum(contrast, FINEST) / FINEST) / per_step
    return np.asarray(np.clip(steps, 0, STEPS), np.int32)
