"""What the ground of one picture is like at the size of a person: its colour, and how much it differs from place to place.

A matched filter for a square of a person's size in CIE L*a*b*, whitened by the covariance of the ground around (I. S. Reed and
X. Yu, IEEE Trans. ASSP 38(10), 1990). Its output over ground without a person is clutter: contrast counts by how much of that
there is, as after Johnson (1958) in D. E. Schmieder and M. R. Weathersby, IEEE Trans. AES 19(4), 1983.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from gcs_mosaic.render.counts_range import sample_of
from gcs_mosaic.render.exposure import is_grey
from gcs_mosaic.stitch.arrays import Array, FloatImage, ImageBGR, PointsNx2

# Lengths in sides of a person unless stated otherwise.
SIDE_PX = 3  # of a person in the analysed picture, where the original is as fine
MOST_PX = 6_000_000  # analysed of a picture: half a GB while that is done
SURROUND = 9  # against which it has to stand out
AROUND = 25  # over which the ground is taken to be of one kind
STEP = 8  # between two places that are told of
NOISE = 0.5  # of L*a*b*, one deviation: less is rounding
TAIL = 0.999  # of a picture is less odd than what stands out there by itself


@dataclass(frozen=True, slots=True)
class FilteredPicture:
    """`means`: (h, w, 3) L*a*b* averaged over a person's size; `local`: the same less that of the surroundings. `scale`: pixels
    of it per pixel of the original; `side`: of a person in it, px; `is_grey`: it has one band."""

    means: FloatImage
    local: FloatImage
    scale: float
    side: int
    is_grey: bool


@dataclass(frozen=True, slots=True)
class GroundStatistics:
    """Of a picture on a grid (rows, columns), each `step_px` of the original apart, the first half of that from the corner."""

    colours: Array  # (rows, columns, 3) L*a*b*
    covariances: Array  # (rows, columns, 3, 3) of the filter's output
    tail: float  # what it exceeds in a thousandth of the picture, in deviations
    sunlit: float  # L* of what is well lit
    step_px: float
    width: float  # px, of the original
    is_grey: bool

    def at(self, pixels: PointsNx2) -> tuple[Array, Array]:
        """Rows and columns of the grid (n,) nearest to pixels (n, 2) of the original."""
        column, row = np.clip(
            np.floor((np.nan_to_num(pixels, nan=0.0) + 0.5) / self.step_px),
            0,
            [self.colours.shape[1] - 1, self.colours.shape[0] - 1],
        ).T.astype(int)
        return row, column


def analysed_scale(width: int, height: int, side_px: float) -> float:
    """Pixels that are analysed of a picture's each, in which a person's side is so many."""
    return min(1.0, SIDE_PX / side_px, math.sqrt(MOST_PX / max(1, width * height)))


def filtered(picture: ImageBGR, side_px: float) -> FilteredPicture:
    """Of a picture (h, w, 3) in which a person's side is so many pixels."""
    height, width = picture.shape[:2]
    scale = analysed_scale(width, height, side_px)
    size = max(8, round(width * scale)), max(8, round(height * scale))
    small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA) if scale < 1 else picture
    lab = np.asarray(cv2.cvtColor(small.astype(np.float32) / np.float32(255), cv2.COLOR_BGR2Lab), np.float32)
    side = int(np.clip(round(side_px * scale), 1, SIDE_PX))
    means = _box(lab, side)
    return FilteredPicture(
        means, means - _box(means, SURROUND * side), size[0] / width, side, is_grey(sample_of(small))
    )


def statistics(picture: FilteredPicture) -> GroundStatistics:
    """Of the ground; a person in it is taken for ground, as long as there are not many."""
    around, step = AROUND * picture.side, STEP * picture.side
    outer = np.stack([picture.local[..., i] * picture.local[..., j] for i, j in _PAIRS], axis=-1)
    moments = _sampled(_box(outer, around), step)
    covariances = np.empty((*moments.shape[:2], 3, 3))
    for k, (i, j) in enumerate(_PAIRS):
        covariances[..., i, j] = covariances[..., j, i] = moments[..., k]
    covariances += np.eye(3) * NOISE**2
    colours = _sampled(_box(picture.means, around), step)
    return GroundStatistics(
        colours=colours,
        covariances=covariances,
        tail=float(np.quantile(scores(picture, covariances)[:: picture.side, :: picture.side], TAIL)),
        sunlit=float(np.quantile(colours[..., 0], 0.8)),
        step_px=step / picture.scale,
        width=picture.means.shape[1] / picture.scale,
        is_grey=picture.is_grey,
    )


def scores(picture: FilteredPicture, covariances: Array) -> FloatImage:
    """How far each place (h, w) of the picture is from its surroundings, in deviations of the ground there."""
    height, width = picture.local.shape[:2]
    whitening = np.linalg.inv(np.linalg.cholesky(covariances)).reshape(*covariances.shape[:2], 9)
    found = np.zeros((height, width), np.float32)
    for row in range(3):
        part = np.zeros((height, width), np.float32)
        for column in range(row + 1):
            weight = np.asarray(whitening[..., 3 * row + column], np.float32)
            part += cv2.resize(weight, (width, height), interpolation=cv2.INTER_LINEAR) * picture.local[..., column]
        found += part * part
    return np.asarray(np.sqrt(found), np.float32)


def disagreement(one: FilteredPicture, other: FilteredPicture, pixels: FloatImage, step: int) -> Array:
    """How much two looks differ in L* at a person's size, one deviation, on the grid of the first one's statistics; NaN where the
    other does not see it. `pixels` (rows, columns, 2): of the analysed `other`, for a coarse mesh over the first, from corner to
    corner.

    Open ground looks the same from two sides, but for noise; leaves at many heights do not.
    """
    height, width = one.means.shape[:2]
    down = np.linspace(0, pixels.shape[0] - 1, height, dtype=np.float32)
    across = np.linspace(0, pixels.shape[1] - 1, width, dtype=np.float32)
    x, y = cv2.split(cv2.remap(pixels, *np.meshgrid(across, down), cv2.INTER_LINEAR))
    there = np.ascontiguousarray(other.local[..., 0])
    seen = cv2.remap(there, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=math.nan)
    known = np.isfinite(seen)
    squared = np.where(known, (seen - one.local[..., 0]) ** 2, 0).astype(np.float32)
    around = AROUND * one.side
    share = _box(known.astype(np.float32), around)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.where(share > 0.5, _box(squared, around) / share, np.nan)
    return np.sqrt(_sampled(mean, step))


_PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


def _box(values: FloatImage, side: int) -> FloatImage:
    if values.ndim == 3 and values.shape[2] > 4:
        return np.dstack([_box(np.ascontiguousarray(values[..., k]), side) for k in range(values.shape[2])])
    return np.asarray(cv2.blur(values, (side, side), borderType=cv2.BORDER_REFLECT_101), np.float32)


def _sampled(values: FloatImage, step: int) -> Array:
    half = min(step // 2, min(values.shape[:2]) - 1)
    return np.asarray(values[half::step, half::step], np.float64)
