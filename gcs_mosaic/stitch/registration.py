"""Do two frames show the same ground? Robust homography and the checks that keep chance agreements out.

MAGSAC++: Barath et al., CVPR 2020 (in OpenCV as USAC_MAGSAC). The test on the number of inliers follows Brown and Lowe,
IJCV 74(1), 2007: of the matches that fall where the frames would overlap, a true overlap confirms a good part.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.stitch.features import Features
from gcs_mosaic.stitch.matching import match

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class RegistrationSettings:
    """When two frames are believed to show the same ground."""

    threshold_px: float = 4.0  # how far relief and lens may carry an inlier, in pixels of the feature picture
    least_inliers: int = 12  # independent ones; false pairs have reached as many, so this alone never decides
    least_share: float = 0.2  # inliers wanted of the matches that lie in the overlap, on top of `share_offset`
    share_offset: float = 8.0  # inliers wanted however few matches there are (Brown and Lowe)
    cell_px: float = 16.0  # inliers nearer than this, in pixels of the feature picture, count as one
    largest_zoom: float = 5.0  # change of scale between two frames that is still believed


@dataclass(frozen=True, slots=True)
class Registration:
    """Two frames that overlap: inlier pixels of each, (m, 2) in full resolution, and b_from_a (3x3)."""

    pixels_a: Array
    pixels_b: Array
    b_from_a: Array
    independent_inliers: int


@dataclass(frozen=True, slots=True)
class NotRegistered:
    """Two frames that do not overlap as far as can be seen, and why."""

    reason: str
    inliers: int


def register(
    a: Features,
    b: Features,
    settings: RegistrationSettings,
    seen_a: NDArray[np.bool_] | None = None,
    seen_b: NDArray[np.bool_] | None = None,
) -> Registration | NotRegistered:
    """Find the common ground of two frames; `seen_a`, `seen_b` (n,) limit the search to some of their features."""
    chosen_a, chosen_b = _chosen(a, seen_a), _chosen(b, seen_b)
    pairs = match(a.descriptors[chosen_a], b.descriptors[chosen_b])
    if len(pairs) < settings.least_inliers:
        return NotRegistered("few matches", len(pairs))
    small_a = a.points[chosen_a[pairs[:, 0]]].astype(np.float64) / a.scale
    small_b = b.points[chosen_b[pairs[:, 1]]].astype(np.float64) / b.scale
    homography, inlier = robust_homography(small_a, small_b, settings.threshold_px)
    if homography is None:
        return NotRegistered("no common homography", 0)
    independent = independent_count(small_a[inlier], small_b[inlier], settings.cell_px)
    reason = _implausible(homography, small_a, inlier, independent, b, settings)
    if reason:
        return NotRegistered(reason, independent)
    full_from_small_a, full_from_small_b = np.diag([a.scale, a.scale, 1]), np.diag([b.scale, b.scale, 1])
    b_from_a = full_from_small_b @ homography @ np.linalg.inv(full_from_small_a)
    return Registration(small_a[inlier] * a.scale, small_b[inlier] * b.scale, b_from_a, independent)


def robust_homography(a: Array, b: Array, threshold: float) -> tuple[Array | None, NDArray[np.bool_]]:
    """b_from_a (3x3) and the inliers (m,) of matched points (m, 2), or None."""
    homography, inlier = cv2.findHomography(
        a, b, cv2.USAC_MAGSAC, threshold, maxIters=2000, confidence=0.9995
    )  # fmt: skip
    if homography is None or not np.isfinite(homography).all():
        return None, np.zeros(len(a), bool)
    return np.asarray(homography, dtype=np.float64), inlier.ravel().astype(bool)


def independent_count(a: Array, b: Array, cell: float) -> int:
    """Number of inliers that no other one lies next to, in either frame: features pile up on one spot."""
    return min(len(np.unique((points // cell).astype(np.int64), axis=0)) for points in (a, b))


def _chosen(features: Features, seen: NDArray[np.bool_] | None) -> NDArray[np.intp]:
    return np.arange(len(features)) if seen is None else np.flatnonzero(seen)


def _implausible(
    homography: Array,
    a: Array,
    inlier: NDArray[np.bool_],
    independent: int,
    b: Features,
    settings: RegistrationSettings,
) -> str:
    """Why this homography cannot be two views of one ground, or nothing."""
    in_overlap = _inside(_mapped(homography, a), b.width / b.scale, b.height / b.scale).sum()
    needed = max(settings.least_inliers, settings.share_offset + settings.least_share * in_overlap)
    if independent < needed:
        return f"{independent} independent inliers, {needed:.0f} needed"
    depth = a[inlier] @ homography[2, :2] + homography[2, 2]
    area = np.linalg.det(homography) / depth**3
    if (area <= 0).any():
        return "the ground would be seen from below"
    zoom = np.sqrt(area)
    if zoom.max() > settings.largest_zoom or zoom.min() < 1 / settings.largest_zoom:
        return f"change of scale {zoom.min():.2f} to {zoom.max():.2f}"
    return ""


def _mapped(homography: Array, points: Array) -> Array:
    return np.asarray(cv2.perspectiveTransform(points[None], homography)[0])


def _inside(points: Array, width: float, height: float) -> NDArray[np.bool_]:
    return np.asarray(((points >= 0) & (points < [width, height])).all(axis=1))


def well_spread(points: Array, count: int) -> NDArray[np.intp]:
    """Indices of at most `count` of the points (n, 2), each as far as possible from those already chosen."""
    if len(points) <= count:
        return np.arange(len(points))
    chosen = [int(((points - points.mean(axis=0)) ** 2).sum(axis=1).argmax())]
    distance = ((points - points[chosen[0]]) ** 2).sum(axis=1)
    for _ in range(count - 1):
        chosen.append(int(distance.argmax()))
        distance = np.minimum(distance, ((points - points[chosen[-1]]) ** 2).sum(axis=1))
    return np.array(chosen)
