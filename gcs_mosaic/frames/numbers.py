"""Counts of 16 bits for files of other numbers: temperatures or reflectances as floats, counts with a sign or of 32 bits.

Everything behind the decoder works on counts without a sign. Which count a number becomes is told by the file alone, and must be
the same for all frames of a camera, whatever else they show: so there are three scales only, far apart from each other.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.frames.structure import StructureError
from gcs_mosaic.stitch.arrays import Bands

Numbers = NDArray[np.float64]

SAMPLE = 200_000  # numbers, about, by which the scale is chosen
AT_ONCE = 1_000_000  # numbers that become counts together
EDGE = 0.005  # share of them at either end that does not decide: dead pixels, glints
# What is not a number of the scene: GDAL's and others' marks for no data lie beyond.
LEAST, MOST = -9999.0, 1e6
COUNTS = 65_535
MOST_THERMAL = 1_400_000  # px: no uncooled sensor has more


@dataclass(frozen=True, slots=True)
class NumberScale:
    """A count is a number less `zero`, over `step`: the count is 0 at `zero`."""

    step: float
    zero: float

    def counts(self, stored: NDArray[Any]) -> Bands:
        """Of any shape, as uint16; 0, as of a dead line, for what is no number."""
        numbers = stored.astype(np.float64)
        known = np.where(_is_number(numbers), numbers, self.zero)
        return np.asarray(np.clip(np.rint((known - self.zero) / self.step), 0, COUNTS), np.uint16)


# Shares, as of light: four times what a white panel reflects is the most.
SHARES = NumberScale(1 / 16_384, 0.0)
MOST_SHARE, LEAST_SHARE = 2.0, -0.05  # between which such pictures lie, but for EDGE
# Degrees, of Celsius, Fahrenheit or kelvin, and counts from which a mean was subtracted: a step is finer than a sensor's noise
# (0.03 to 0.1 K). A frame belongs here by its middle, whatever fire or sky is in it.
DEGREES = NumberScale(0.02, -655.36)
MOST_DEGREES = 600.0
AS_THEY_ARE = NumberScale(
    1.0, 0.0
)  # whole numbers without a sign, as counts are in any format; and what is larger than degrees
SIGNED = NumberScale(1.0, -32_768.0)  # of 16 bits


def counts_of(image: NDArray[Any]) -> Bands:
    """An image (h, w, bands) as uint8 or uint16; itself if it is one of these. Raises StructureError for numbers that no scale
    fits."""
    if image.dtype in (np.uint8, np.uint16):
        return image
    if image.dtype == np.int8:
        return np.asarray(image.astype(np.int16) + 128, np.uint8)
    if image.dtype == np.int16:
        return np.asarray(image.astype(np.int32) - round(SIGNED.zero), np.uint16)
    scale = scale_of(image)
    rows = max(1, AT_ONCE // max(1, image[0].size))  # all at once is eight times as large as the file
    return np.concatenate([scale.counts(image[top : top + rows]) for top in range(0, len(image), rows)])


def scale_of(image: NDArray[Any]) -> NumberScale:
    """By which an image of any shape becomes counts. Raises StructureError where none fits its numbers."""
    if image.dtype in (np.int8, np.int16):
        return SIGNED if image.dtype == np.int16 else NumberScale(1.0, -128.0)
    if image.dtype in (np.uint8, np.uint16):
        return AS_THEY_ARE
    some = image.ravel()[:: max(1, image.size // SAMPLE)].astype(np.float64)
    some = some[_is_number(some)]
    if not some.size:
        raise StructureError("damaged: a picture of floats without a number in it")
    low, middle, high = np.quantile(some, (EDGE, 0.5, 1 - EDGE)).tolist()
    is_counts = low >= 0 and high <= COUNTS
    if is_counts and high > MOST_SHARE and not (some % 1).any():
        return AS_THEY_ARE
    if low >= LEAST_SHARE and high <= MOST_SHARE:
        return SHARES
    if abs(middle) <= MOST_DEGREES:
        return DEGREES
    if middle > 0 and high <= COUNTS:
        return AS_THEY_ARE
    raise StructureError(
        f"numbers from {low:g} to {high:g} are not read: shares up to {MOST_SHARE:g}, degrees, and counts up to {COUNTS} are"
    )


def _is_number(numbers: Numbers) -> NDArray[np.bool_]:
    return np.asarray(np.isfinite(numbers) & (numbers > LEAST) & (numbers < MOST))
