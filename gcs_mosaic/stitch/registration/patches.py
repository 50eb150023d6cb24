"""Dense correspondences: patches of one frame's texture found in another's, around a homography that is known to be right.

Keypoints that match again may be few, or all in one corner. The patches lie on a grid over the whole overlap; each is sought
around where the homography puts it, as far as things on the ground may be displaced by their height, and kept where one place
stands out.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from gcs_mosaic.stitch.arrays import AnyArray, FloatImage, Matrix3x3, PointsNx2, Vector2
from gcs_mosaic.stitch.features.extraction import Features
from gcs_mosaic.stitch.features.texture import coarse, full_from_picture
from gcs_mosaic.stitch.registration.homography import mapped

BLUR = 1.0  # px of the texture, sigma; pixel noise and compression would hide what correlates
LEAST_LEAD = 0.1  # correlation over the best place that is not beside it: rows look alike along themselves
BESIDE = 2  # px
ENOUGH = 12  # patches, from which on larger ones tell nothing more


@dataclass(frozen=True, slots=True, kw_only=True)
class PatchSize:
    """In px of the texture, or of the coarse one: the side of a patch, the step between two, the reach by which a patch may be
    displaced, and the correlation by which it is believed. By chance the best place around a small patch has 0.4, around a
    large one of the coarse texture 0.3."""

    is_coarse: bool
    side: int
    step: int
    reach: int
    least_correlation: float


# The smallest that are found tell the places best. Crowns that wind and parallax have changed are only found as large ones.
SIZES = (
    PatchSize(is_coarse=False, side=24, step=28, reach=7, least_correlation=0.5),
    PatchSize(is_coarse=True, side=32, step=20, reach=6, least_correlation=0.5),
    PatchSize(is_coarse=True, side=48, step=24, reach=6, least_correlation=0.35),
)


@dataclass(frozen=True, slots=True)
class Patches:
    """Places of the same ground, (n, 2) full-resolution pixels of each frame; `tried`: patches that both should show."""

    pixels_a: PointsNx2
    pixels_b: PointsNx2
    tried: int


def patches(a: Features, b: Features, b_from_a: Matrix3x3) -> Patches:
    """Patches of frame a found in frame b around where the homography (full resolution) puts them: the smallest that are found
    often enough, else the most."""
    found = Patches(np.empty((0, 2)), np.empty((0, 2)), 0)
    for size in SIZES:
        some = _found(a, b, b_from_a, size)
        if len(some.pixels_a) > len(found.pixels_a):
            found = some
        if len(found.pixels_a) >= ENOUGH:
            break
    return found


def _found(a: Features, b: Features, b_from_a: Matrix3x3, size: PatchSize) -> Patches:
    picture_a, picture_b = (_picture(frame, size.is_coarse) for frame in (a, b))
    full_a = full_from_picture(a.width, a.height, picture_a.shape)
    full_b = full_from_picture(b.width, b.height, picture_b.shape)
    there_from_here = np.linalg.inv(full_b) @ b_from_a @ full_a
    laid, seen = _laid(picture_b, there_from_here, picture_a.shape)
    corners = [corner for corner in _grid(picture_a.shape, size) if _shows(_around(seen, corner, size))]
    shifts = {corner: _shift(picture_a, laid, corner, size) for corner in corners}
    kept = {corner: shift for corner, shift in shifts.items() if shift is not None}
    if not kept:
        return Patches(np.empty((0, 2)), np.empty((0, 2)), len(corners))
    middles = np.array(list(kept), np.float64) + (size.side - 1) / 2
    moved = middles + np.array(list(kept.values()))
    return Patches(mapped(full_a, middles), mapped(full_b @ there_from_here, moved), len(corners))


def _picture(frame: Features, is_coarse: bool) -> FloatImage:
    texture = frame.texture
    assert texture is not None, "only frames with textures are compared as pictures"
    if is_coarse:
        return coarse(texture)
    return np.asarray(cv2.GaussianBlur(texture.astype(np.float32), (0, 0), BLUR), dtype=np.float32)


def _laid(picture_b: FloatImage, b_from_a: Matrix3x3, shape: tuple[int, ...]) -> tuple[FloatImage, FloatImage]:
    """Picture b as frame a sees it (h, w), and where b sees anything of it."""
    size, flags = shape[::-1], cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    laid = cv2.warpPerspective(picture_b, b_from_a, size, flags=flags)
    seen = cv2.warpPerspective(np.ones_like(picture_b), b_from_a, size, flags=flags)
    return np.asarray(laid, np.float32), np.asarray(seen, np.float32)


def _grid(shape: tuple[int, ...], size: PatchSize) -> list[tuple[int, int]]:
    """Upper left corners (x, y) of patches whose surroundings lie within the picture."""
    across, down = (range(size.reach, length - size.side - size.reach, size.step) for length in (shape[1], shape[0]))
    return [(x, y) for y in down for x in across]


def _around(picture: FloatImage, corner: tuple[int, int], size: PatchSize) -> FloatImage:
    x, y = corner
    stop = size.side + size.reach
    return picture[y - size.reach : y + stop, x - size.reach : x + stop]


def _shows(seen: FloatImage) -> bool:
    return bool(min(seen[0, 0], seen[0, -1], seen[-1, 0], seen[-1, -1]) > 0.99)


def _shift(picture_a: FloatImage, laid: FloatImage, corner: tuple[int, int], size: PatchSize) -> Vector2 | None:
    """By how much a patch is displaced, (2,) px to a fraction; None where no place stands out."""
    x, y = corner
    patch = picture_a[y : y + size.side, x : x + size.side]
    scores = cv2.matchTemplate(_around(laid, corner, size), patch, cv2.TM_CCOEFF_NORMED)
    row, column = np.unravel_index(int(scores.argmax()), scores.shape)
    best = float(scores[row, column])
    last = 2 * size.reach
    if best < size.least_correlation or not (0 < row < last and 0 < column < last):
        return None
    rows, columns = np.ogrid[: scores.shape[0], : scores.shape[1]]
    elsewhere = np.maximum(abs(rows - row), abs(columns - column)) > BESIDE
    if best - float(scores[elsewhere].max()) < LEAST_LEAD:
        return None
    along = [_vertex(scores[row, column - 1 : column + 2]), _vertex(scores[row - 1 : row + 2, column])]
    return np.array([column - size.reach, row - size.reach], np.float64) + along


def _vertex(values: AnyArray) -> float:
    """Place of the top of a parabola through three values, the middle one the largest."""
    left, middle, right = map(float, values.ravel())
    bend = left - 2 * middle + right
    return 0.0 if bend >= 0 else float(np.clip((left - right) / (2 * bend), -0.5, 0.5))
