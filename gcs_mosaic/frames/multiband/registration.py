"""Registers a band to another one by pixels. Bands differ in contrast, even in its sign, so the strength of edges is compared,
freed of its local mean and contrast. A first shift is found on a small picture, then a homography from many patches.

It is believed only if the patches in all parts of the picture are found clearly in one place each, and these agree.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np

from gcs_mosaic.stitch.arrays import AnyArray, Array, Matrix3x3, PointsNx2

WORK_PX = 1000  # longer pictures are registered at a whole fraction of their size, to a tenth of a pixel
COARSE_PX = 320
FARTHEST = (
    0.12  # shift as a share of the picture's sides: lenses of one rig look at the same ground, pictures in a row do not
)
MOST_STRETCH = 1.25  # of areas
CLEAR = 0.7  # the second best place, as a share of the agreement at the best
ROUNDS = 3
COLUMNS, ROWS = 8, 6  # of patches
AGREE_PX = 1.5
LEAST_PATCHES, LEAST_IN_QUARTER = 12, 2
LEAST_SHARE = 0.6  # of the patches that are found clearly
_SMOOTH_PX, _LOCAL_PX = 1.0, 41


@dataclass(frozen=True, slots=True)
class Edges:
    """Of one band: `fine` (h, w) at 1 / `reduction` of its size, `coarse` (h, w) at a smaller one."""

    fine: Array
    coarse: Array
    reduction: int


def edges_of(band: AnyArray) -> Edges:
    """Of a band (h, w) of counts."""
    height, width = band.shape
    reduction = -(-max(height, width) // WORK_PX)
    work = _resized(band, width // reduction, height // reduction)
    share = min(1.0, COARSE_PX / max(work.shape))
    coarse = _resized(work, round(work.shape[1] * share), round(work.shape[0] * share))
    return Edges(_normalised_edges(work), _normalised_edges(coarse), reduction)


def registered(reference: Edges, band: Edges, first: Matrix3x3 | None = None) -> Matrix3x3 | None:
    """Homography from the reference's pixels to the band's, both of one size; None if it is not clear.

    `first`: where it is likely to be, which is tried before it is sought."""
    scale = _reduced_by(reference.reduction)
    starts = [] if first is None else [scale @ first @ np.linalg.inv(scale)]
    for start in (*starts, None):
        found = _coarse_shift(reference, band) if start is None else start
        found = None if found is None else _refined(reference.fine, band.fine, found)
        if found is not None:
            full = np.linalg.inv(scale) @ found @ scale
            return np.asarray(full / full[2, 2], np.float64)
    return None


def mapped(homography: Matrix3x3, points: PointsNx2) -> PointsNx2:
    """The points at which a homography puts points."""
    return np.asarray(cv2.perspectiveTransform(points[None].astype(np.float64), homography)[0], np.float64)


def corners(width: int, height: int) -> PointsNx2:
    """(4, 2) of a picture."""
    right, below = width - 1.0, height - 1.0
    return np.array([[0.0, 0.0], [right, 0.0], [right, below], [0.0, below]])


def _resized(image: AnyArray, width: int, height: int) -> AnyArray:
    return np.asarray(
        cv2.resize(image.astype(np.float32), (max(width, 1), max(height, 1)), interpolation=cv2.INTER_AREA)
    )


def _normalised_edges(image: AnyArray) -> Array:
    smooth = cv2.GaussianBlur(image.astype(np.float32), (0, 0), _SMOOTH_PX)
    strength = cv2.magnitude(cv2.Sobel(smooth, cv2.CV_32F, 1, 0), cv2.Sobel(smooth, cv2.CV_32F, 0, 1))
    above = strength - cv2.blur(strength, (_LOCAL_PX, _LOCAL_PX))
    local = np.sqrt(cv2.blur(above * above, (_LOCAL_PX, _LOCAL_PX)))
    # Where there is next to nothing to be seen, noise is not to look like structure.
    return np.asarray(above / (local + 0.2 * float(np.median(local)) + 1e-6))


def _reduced_by(reduction: int) -> Matrix3x3:
    """From pixels to those of the reduced picture, whose first lies in the middle of several."""
    share, shift = 1 / reduction, (1 / reduction - 1) / 2
    return np.array([[share, 0.0, shift], [0.0, share, shift], [0.0, 0.0, 1.0]])


def _coarse_shift(reference: Edges, band: Edges) -> Matrix3x3 | None:
    """A shift at the size of the fine pictures; None if another one would do nearly as well, as over rows of plants."""
    height, width = reference.coarse.shape
    aside, above = round(width * FARTHEST), round(height * FARTHEST)
    # Turned and scaled a little, edges meet only if they are wide.
    wide = [cv2.GaussianBlur(one, (0, 0), 1.5) for one in (reference.coarse, band.coarse)]
    found = _best_place(wide[1], wide[0][above : height - above, aside : width - aside], beyond_px=5)
    if found is None:
        return None
    scale = reference.fine.shape[1] / width
    shift = np.eye(3)
    shift[:2, 2] = (found - (aside, above)) * scale
    return shift


def _best_place(window: AnyArray, template: AnyArray, beyond_px: int) -> Array | None:
    """(x, y) of the template in the window, to parts of a pixel; None unless the agreement there is clearly above that at places
    farther away, or if it grows towards the border."""
    if min(template.shape) < 8 or template.std() < 0.1:
        return None
    agreement = cv2.matchTemplate(window, template, cv2.TM_CCOEFF_NORMED)
    _, best, _, (x, y) = cv2.minMaxLoc(agreement)
    height, width = agreement.shape
    if not (0 < x < width - 1 and 0 < y < height - 1) or not best > 0:
        return None
    elsewhere = agreement.copy()
    elsewhere[max(y - beyond_px, 0) : y + beyond_px + 1, max(x - beyond_px, 0) : x + beyond_px + 1] = -1.0
    if elsewhere.max() > CLEAR * best:
        return None
    return np.array([x + _vertex(*agreement[y, x - 1 : x + 2]), y + _vertex(*agreement[y - 1 : y + 2, x])])


def _vertex(before: float, here: float, after: float) -> float:
    """Of a parabola through three values, of which the middle one is the largest."""
    curve = before - 2 * here + after
    return 0.0 if curve >= 0 else float(np.clip((before - after) / (2 * curve), -0.5, 0.5))


def _refined(reference: Array, band: Array, start: Matrix3x3) -> Matrix3x3 | None:
    found = start
    for _ in range(ROUNDS):
        if not _is_plausible(found, reference.shape):
            return None
        here, there = _pairs(reference, band, found)
        if len(here) < LEAST_PATCHES:
            return None
        better, agree = cv2.findHomography(here, there, cv2.RANSAC, AGREE_PX)
        if better is None or not _is_enough(here, agree.ravel().astype(bool), reference.shape):
            return None
        found = np.asarray(better, np.float64)
    return found if _is_plausible(found, reference.shape) else None


def _pairs(reference: Array, band: Array, homography: Matrix3x3) -> tuple[PointsNx2, PointsNx2]:
    """(n, 2) places in the reference and in the band, of patches that are found clearly."""
    height, width = reference.shape
    size, how = (width, height), cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    laid = np.asarray(cv2.warpPerspective(band, homography, size, flags=how))
    inside = np.asarray(
        cv2.warpPerspective(np.ones(band.shape, np.uint8), homography, size, flags=cv2.WARP_INVERSE_MAP)
    )
    here, there = list[Array](), list[Array]()
    half = int(np.clip(min(height, width) // 16, 12, 48))
    reach = max(6, width // 100)
    for x, y in _centres(width, height, half + reach):
        rows, columns = slice(y - half - reach, y + half + reach), slice(x - half - reach, x + half + reach)
        if not inside[rows, columns].all():
            continue
        patch = reference[y - half : y + half, x - half : x + half]
        place = _best_place(laid[rows, columns], patch, beyond_px=4)
        if place is not None:
            here.append(np.array([x, y], np.float64))
            there.append(np.array([x, y]) + place - reach)
    if not here:
        return np.empty((0, 2)), np.empty((0, 2))
    return np.array(here), mapped(homography, np.array(there))


def _centres(width: int, height: int, border: int) -> Iterator[tuple[int, int]]:
    if min(width, height) <= 2 * border:
        return
    for y in np.linspace(border, height - border, ROWS):
        for x in np.linspace(border, width - border, COLUMNS):
            yield int(x), int(y)


def _is_enough(places: PointsNx2, agree: Array, shape: tuple[int, ...]) -> bool:
    """Whether those that agree are most, and in every quarter of the picture, so that they determine a homography."""
    quarters = 2 * (places[agree, 1] > shape[0] / 2) + (places[agree, 0] > shape[1] / 2)
    counts = np.bincount(quarters.astype(int), minlength=4)
    enough = agree.sum() >= max(LEAST_PATCHES, LEAST_SHARE * len(places))
    return bool(enough and counts.min() >= LEAST_IN_QUARTER)


def _is_plausible(homography: Matrix3x3, shape: tuple[int, ...]) -> bool:
    """As of lenses beside each other."""
    height, width = shape[:2]
    before = corners(width, height)
    after = mapped(homography, before)
    if not np.isfinite(after).all() or (np.abs(after - before) > 1.25 * FARTHEST * np.array([width, height])).any():
        return False
    area = abs(cv2.contourArea(after.astype(np.float32))) / abs(cv2.contourArea(before.astype(np.float32)))
    return 1 / MOST_STRETCH < area < MOST_STRETCH
