"""Sensor model: converts light to counts per band, and encodes the file.

Every band is a linear combination of blue, green and red, so its truth is known wherever the ground is.
"""

from __future__ import annotations

import io
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import tifffile
from numpy.typing import NDArray

from .ground.raster import Field

# Weights of blue, green and red in the bands blue, green, red, red edge, near infrared (bright vegetation) and panchromatic.
MIXTURES = np.array(
    [[1, 0, 0], [0, 1, 0], [0, 0, 1], [-0.2, 0.8, 0.4], [-0.4, 1.9, -0.5], [0.33, 0.34, 0.33]], np.float32
)
LUMINANCE = np.array([[0.114, 0.587, 0.299]], np.float32)
MOST_BANDS = len(MIXTURES)
EIGHT, DEEP, THERMAL = (0.0, 1.0), (200.0, 40.0), (29_000.0, 1.5)  # counts in the dark, counts per grey level of 255


@dataclass(frozen=True, slots=True, kw_only=True)
class Sensor:
    """`bands` of `depth` bits. Three bands of 8 bits are a JPEG, all others a TIFF; one band of 16 bits resembles a thermal
    camera: a few hundred counts of contrast on a large offset."""

    bands: int = 3
    depth: int = 8

    def __post_init__(self) -> None:
        if not 1 <= self.bands <= MOST_BANDS or self.depth not in (8, 16):
            raise ValueError(f"{self.bands} bands of {self.depth} bits: there are 1 to {MOST_BANDS}, of 8 or 16 bits")

    @property
    def suffix(self) -> str:
        return ".JPG" if (self.bands, self.depth) == (3, 8) else ".TIF"

    def levels(self, light: Field) -> Field:
        """Light (..., 3) in BGR -> grey levels (..., bands)."""
        mixtures = LUMINANCE if self.bands == 1 else MIXTURES[: self.bands]
        return light if self.bands == 3 else np.asarray(np.maximum(light @ mixtures.T, 0), np.float32)

    def counts(self, levels: Field) -> NDArray[Any]:
        """Counts (..., bands), uint8 or uint16."""
        dark, per_level = self.response
        kind = np.uint8 if self.depth == 8 else np.uint16
        return np.asarray(np.clip(dark + per_level * levels + 0.5, 0, np.iinfo(kind).max), kind)

    @property
    def response(self) -> tuple[float, float]:
        """Dark counts, and counts per grey level."""
        return EIGHT if self.depth == 8 else THERMAL if self.bands == 1 else DEEP

    def encoded(self, counts: NDArray[Any], quality: int) -> bytes:
        """The encoded file of a picture (h, w, bands); `quality` applies to JPEG."""
        if self.suffix == ".JPG":
            done, data = cv2.imencode(".jpg", counts, [cv2.IMWRITE_JPEG_QUALITY, quality])
            assert done
            return bytes(data)
        file, photometric = io.BytesIO(), "rgb" if self.bands == 3 else "minisblack"
        image = counts[..., 0] if self.bands == 1 else counts[..., ::-1] if self.bands == 3 else counts
        planar = None if self.bands == 1 else "contig"
        tifffile.imwrite(file, np.ascontiguousarray(image), photometric=photometric, planarconfig=planar, metadata=None)
        return file.getvalue()
