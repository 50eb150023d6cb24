"""Keypoints and descriptors by name: SIFT, ORB, SURF.

SIFT: Lowe, IJCV 60(2), 2004. ORB: Rublee et al., ICCV 2011. SURF: Bay et al., CVIU 110(3), 2008; from mahotas, as OpenCV's
wheels do not include it.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.stitch.arrays import Descriptors, FloatRows, ImageGrey, PointsNx2, Vector

FeatureKind = Literal["sift", "orb", "surf"]

ORB_SCALE = 1.2  # between the levels of ORB's pyramid
# SIFT's scale space takes 200 bytes a pixel, and all cores anyway: of two pictures at once, one waits.
ONE_AT_A_TIME = threading.Lock()
SURF_DESCRIPTOR = 6  # first descriptor column in mahotas' rows: y, x, scale, score, laplacian, angle, 64 of descriptor


@dataclass(frozen=True, slots=True)
class Found:
    """Features of an image, strongest first: points (n, 2) in its pixels, descriptors (n, d) as the detector returns them.

    SIFT: float32, d = 128, integers from 0 to 255. ORB: uint8, d = 32, 256 bits. SURF: float32, d = 64, unit length.
    """

    points: PointsNx2
    descriptors: Descriptors


def detect(grey: ImageGrey, kind: FeatureKind, count: int, contrast: float) -> Found:
    """The strongest features of a grey image (h, w), at most `count`. `contrast`: SIFT's threshold, ignored by the others.

    ModuleNotFoundError where `is_available` is False.
    """
    points, strength, descriptors = DETECTORS[kind](grey, count, contrast)
    order = np.argsort(-strength, kind="stable")[:count]
    return Found(points[order], descriptors[order])


def is_available(kind: FeatureKind) -> bool:
    """Whether the library that provides this detector is installed."""
    return kind != "surf" or find_spec("mahotas") is not None


Rows = tuple[PointsNx2, Vector, Descriptors]  # points (n, 2), strength (n,), descriptors (n, d)


def _sift(grey: ImageGrey, count: int, contrast: float) -> Rows:
    # Without precise upscaling OpenCV's SIFT shifts every point by a quarter pixel, which shows between two headings.
    sift = cv2.SIFT.create(nfeatures=count, contrastThreshold=contrast, enable_precise_upscale=True)
    with ONE_AT_A_TIME:
        keypoints, descriptors = sift.detectAndCompute(grey, None)
    if descriptors is None:
        return _nothing(128, np.float32)
    return np.array([k.pt for k in keypoints]), np.array([k.response for k in keypoints]), descriptors


def _orb(grey: ImageGrey, count: int, contrast: float) -> Rows:
    keypoints, descriptors = cv2.ORB.create(nfeatures=count, scaleFactor=ORB_SCALE).detectAndCompute(grey, None)
    if descriptors is None:
        return _nothing(32, np.uint8)
    # OpenCV scales points by the level's nominal factor; levels have integer sides and are aligned at their pixels' edges.
    nominal = ORB_SCALE ** np.array([k.octave for k in keypoints])[:, None]
    size = np.array(grey.shape[::-1])
    points = (np.array([k.pt for k in keypoints]) / nominal + 0.5) * (size / np.rint(size / nominal)) - 0.5
    return points, np.array([k.response for k in keypoints]), descriptors


def _surf(grey: ImageGrey, count: int, contrast: float) -> Rows:
    from mahotas.features import surf  # an optional extra

    found = surf.surf(np.ascontiguousarray(grey), max_points=count)
    if not len(found):
        return _nothing(64, np.float32)
    return found[:, 1::-1], found[:, 3], found[:, SURF_DESCRIPTOR:].astype(np.float32)


def rounded(descriptors: FloatRows) -> NDArray[np.int8]:
    """Unit-length descriptors (n, d), times 127."""
    return np.asarray(np.rint(127 * descriptors), dtype=np.int8)


def _nothing(length: int, dtype: type) -> Rows:
    return np.empty((0, 2)), np.empty(0), np.empty((0, length), dtype)


DETECTORS: dict[FeatureKind, Callable[[ImageGrey, int, float], Rows]] = {
    "sift": _sift,
    "orb": _orb,
    "surf": _surf,
}
