"""Part of a frame that holds a picture: frames that were undistorted, rectified, stabilised or rotated before they came have
wedges around it, and every frame others.

Blocks instead of a polygon: outlines may be curved (a lens straightened), a picture may have holes, and what is asked for, the
distance from the nearest pixel without a picture, is smooth all the same. A block with a single such pixel counts as empty. Pixel
coordinates do not change: what holds no picture is masked, as a dead border is.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from gcs_mosaic.stitch.arrays import AnyPointsNx2, Band, Bands, FloatImage, Mask, Vector32
from gcs_mosaic.stitch.camera.dead_border import DeadBorder

LONGEST = 512  # blocks along the longer side: 8 px of a 12 MP frame
MARGIN = 1.0  # px given up beside empty blocks: resampling has mixed some of the empty pixels into them
FILL = 8  # px of the squares whose means continue the picture beyond its edge
FAR = 1e4  # blocks; farther than anything in a frame
FIELDS_KEPT = 32  # of frames painted together, 1 MB each


@dataclass(frozen=True, slots=True)
class PictureArea:
    """Which blocks (rows, columns) of a frame hold a picture, all of them; packed bits, row by row."""

    rows: int
    columns: int
    bits: bytes

    @staticmethod
    def of(holds: Mask) -> PictureArea | None:
        """From the pixels (h, w) of a frame, reduced or not, that hold a picture; None if all do."""
        if holds.all():
            return None
        shrink = max(1.0, max(holds.shape) / LONGEST)
        rows, columns = (max(1, round(size / shrink)) for size in holds.shape)
        share = cv2.resize(holds.astype(np.float32), (columns, rows), interpolation=cv2.INTER_AREA)
        return PictureArea(rows, columns, np.packbits(share > 1 - 1e-6).tobytes())

    @property
    def blocks(self) -> Mask:
        bits = np.unpackbits(np.frombuffer(self.bits, np.uint8), count=self.rows * self.columns)
        return bits.reshape(self.rows, self.columns).astype(bool)

    def pixels(self, height: int, width: int) -> Mask:
        """Which pixels (h, w) of a picture of the whole frame hold one."""
        size = (width, height)
        return np.asarray(cv2.resize(self.blocks.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0)

    def depth(self, points: AnyPointsNx2, width: int, height: int) -> Vector32:
        """How far points (n, 2), in pixels of a frame of this size, are from what holds no picture, px; negative within it. The
        frame's own border is none. Points outside of the frame are as far as the nearest of its pixels, and NaN far outside."""
        size = np.array([self.columns / width, self.rows / height])
        at = np.nan_to_num((points + 0.5) * size - 0.5, nan=-FAR)
        x, y = (np.clip(at[:, k], 0, most - 1).astype(np.float32) for k, most in ((0, self.columns), (1, self.rows)))
        found = _bilinear(_field(self), x, y) * np.float32(1 / size.mean()) - np.float32(MARGIN)
        return np.where(np.isnan(points).any(axis=1), np.float32(-FAR), found)

    def spares(self, points: AnyPointsNx2, width: int, height: int, reach: float = 0.5) -> Mask:
        """Which points (n, 2), in pixels of a frame of this size, have a picture all around, `reach` px far."""
        return np.asarray(self.depth(points, width, height) >= reach)

    def filled(self, image: Bands) -> Bands:
        """The image (h, w, bands), the frame's reduced or not, with the picture continued smoothly where there is none. Depends
        on nothing that is there now."""
        holds = self.pixels(*image.shape[:2])
        if not holds.any():
            return image
        bands = [_continued(np.ascontiguousarray(image[..., band]), holds) for band in range(image.shape[2])]
        return np.stack(bands, axis=-1)


def filled(image: Bands, dead: DeadBorder, area: PictureArea | None) -> Bands:
    """The image (h, w, bands) with what is dead, or holds no picture, replaced by what is beside it."""
    alive = dead.filled(image)
    return alive if area is None else area.filled(alive)


def _continued(band: Band, holds: Mask) -> Band:
    height, width = band.shape
    size = max(1, width // FILL), max(1, height // FILL)
    weight = cv2.resize(holds.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    levels = cv2.resize(np.where(holds, band, 0).astype(np.float32), size, interpolation=cv2.INTER_AREA)
    known = weight > min(0.5, float(weight.max()) / 2)
    means = levels / np.maximum(weight, np.float32(1e-6))
    # Of each square the number of the nearest one that is known.
    unknown = np.asarray(~known, np.uint8)
    _, labels = cv2.distanceTransformWithLabels(unknown, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)
    of_label = np.zeros(int(labels.max()) + 1, np.float32)
    of_label[labels[known]] = means[known]
    around = cv2.resize(of_label[labels], (width, height), interpolation=cv2.INTER_LINEAR)
    return np.where(holds, band, np.rint(around).astype(band.dtype))


@lru_cache(FIELDS_KEPT)
def _field(area: PictureArea) -> FloatImage:
    """Distance (rows, columns), in blocks, of each block's middle from the edge of the picture; negative outside of it."""
    holds = area.blocks
    if holds.all():
        return np.full(holds.shape, FAR, np.float32)
    if not holds.any():
        return np.full(holds.shape, -FAR, np.float32)
    to_empty, to_picture = (
        cv2.distanceTransform(one.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE) for one in (holds, ~holds)
    )
    return np.asarray(np.where(holds, to_empty - np.float32(0.5), np.float32(0.5) - to_picture), np.float32)


def _bilinear(field: FloatImage, x: Vector32, y: Vector32) -> Vector32:
    """Values of a field (rows, columns) at places within it."""
    left, top = x.astype(np.intp), y.astype(np.intp)
    right, bottom = np.minimum(left + 1, field.shape[1] - 1), np.minimum(top + 1, field.shape[0] - 1)
    across, down = x - left, y - top
    above = field[top, left] * (1 - across) + field[top, right] * across
    below = field[bottom, left] * (1 - across) + field[bottom, right] * across
    return np.asarray(above * (1 - down) + below * down, np.float32)
