"""What a camera makes of light: bands of counts, and the file they are kept in.

Every band is a sum of blue, green and red, so that the truth of each is known wherever the ground is.
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

# Shares of blue, green and red in blue, green, red, red edge, near infrared (which plants shine in) and all light.
MIXTURES = np.array(
    [[1, 0, 0], [0, 1, 0], [0, 0, 1], [-0.2, 0.8, 0.4], [-0.4, 1.9, -0.5], [0.33, 0.34, 0.33]], np.float32
)
LUMINANCE = np.array([[0.114, 0.587, 0.299]], np.float32)
MOST_BANDS = len(MIXTURES)
EIGHT, DEEP, THERMAL = (0.0, 1.0), (200.0, 40.0), (29_000.0, 1.5)  # counts in the dark, counts per grey level of 255


@dataclass(frozen=True, slots=True, kw_only=True)
class Sensor:
    """`bands` of `depth` bits. Three of eight bits are a JPEG, all others a TIFF; one of sixteen bits is like a thermal camera's:
    a few hundred counts of contrast far above zero."""

    bands: int = 3
    depth: int = 8

    def __post_init__(self) -> None:
        if not 1 <= self.bands <= MOST_BANDS or self.depth not in (8, 16):
            raise ValueError(f"{self.bands} bands of {self.depth} bits: there are 1 to {MOST_BANDS}, of 8 or 16 bits")

    @property
    def suffix(self) -> str:
        return ".JPG" if (self.bands, self.depth) == (3, 8) else ".TIF"

    def levels(self, light: Field) -> Field:
        """(..., bands) grey levels of light (..., 3) in blue, green and red."""
        mixtures = LUMINANCE if self.bands == 1 else MIXTURES[: self.bands]
        return light if self.bands == 3 else np.asarray(np.maximum(light @ mixtures.T, 0), np.float32)

    def counts(self, levels: Field) -> NDArray[Any]:
        """(..., bands) uint8 or uint16."""
        dark, per_level = self.response
        kind = np.uint8 if self.depth == 8 else np.uint16
        return np.asarray(np.clip(dark + per_level * levels + 0.5, 0, np.iinfo(kind).max), kind)

    @property
    def response(self) -> tuple[float, float]:
        """Counts in the dark, and counts per grey level."""
        return EIGHT if self.depth == 8 else THERMAL if self.bands == 1 else DEEP

    def encoded(self, counts: NDArray[Any], quality: int) -> bytes:
        """The file of a picture (h, w, bands); `quality` is the JPEG's."""
        if self.suffix == ".JPG":
            done, data = cv2.imencode(".jpg", counts, [cv2.IMWRITE_JPEG_QUALITY, quality])
            assert done
            return bytes(data)
        file, photometric = io.BytesIO(), "rgb" if self.bands == 3 else "minisblack"
        image = counts[..., 0] if self.bands == 1 else counts[..., ::-1] if self.bands == 3 else counts
        planar = None if self.bands == 1 else "contig"
        tifffile.imwrite(file, np.ascontiguousarray(image), photometric=photometric, planarconfig=planar, metadata=None)
        return file.getvalue()
