"""Part of a camera's picture that an overlay covers in every frame: a burnt-in display, a logo, bars, dirt, a leg.

Pixel coordinates do not change: what is covered is masked, as a dead border is.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from gcs_mosaic.stitch.arrays import AnyPointsNx2, Mask


@dataclass(frozen=True, slots=True)
class StillMask:
    """Which blocks (rows, columns) of a frame an overlay covers; packed bits, row by row."""

    rows: int
    columns: int
    bits: bytes

    @staticmethod
    def of(blocks: Mask) -> StillMask:
        rows, columns = blocks.shape
        return StillMask(rows, columns, np.packbits(blocks).tobytes())

    @property
    def blocks(self) -> Mask:
        bits = np.unpackbits(np.frombuffer(self.bits, np.uint8), count=self.rows * self.columns)
        return bits.reshape(self.rows, self.columns).astype(bool)

    def differs(self, other: StillMask) -> float:
        """Share of the frame that only one of two covers; 1 if they are of other shapes."""
        if (self.rows, self.columns) != (other.rows, other.columns):
            return 1.0
        return float((self.blocks != other.blocks).mean())

    def pixels(self, height: int, width: int) -> Mask:
        """Which pixels (h, w) of a picture of the whole frame are covered."""
        size = (width, height)
        return np.asarray(cv2.resize(self.blocks.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0)

    def covers(self, points: AnyPointsNx2, width: int, height: int) -> Mask:
        """Which points (n, 2), in pixels of a frame of this size, are covered."""
        x = (points[:, 0] + 0.5) * (self.columns / width)
        y = (points[:, 1] + 0.5) * (self.rows / height)
        rows, columns = np.clip(y, 0, self.rows - 1).astype(int), np.clip(x, 0, self.columns - 1).astype(int)
        return np.asarray(self.blocks[rows, columns])
