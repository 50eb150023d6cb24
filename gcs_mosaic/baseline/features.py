"""Section III.A: features of the frame, and of the mosaic within the region of interest.

Both at stitching resolution, with the detectors' published settings, without the bounds of the default method.
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from gcs_mosaic.stitch.arrays import Bands, Coverage, ImageBGR, ImageGrey
from gcs_mosaic.stitch.features.detectors import FeatureKind, Found, detect
from gcs_mosaic.stitch.features.extraction import Features, reduced_grey

Span = tuple[int, int]  # first pixel, and the one after the last

MOST_FEATURES = 10_000  # per frame; the paper's own counts are 6,704 (SIFT), 3,927 (SURF) and 9,973 (ORB)
CONTRAST = 0.04  # SIFT's threshold (Lowe: 0.03 of a scale that OpenCV divides by the layers per octave)
BLOCK = 2048  # px a side: SIFT takes 60 bytes per image byte, so a large region is processed in blocks
MARGIN = 128  # px around a block available to its descriptors


def frame_features(image: Bands, kind: FeatureKind, reduction: int) -> Features:
    """Features of a frame (h, w, bands) reduced by an integer factor; points in full-resolution pixels.

    Descriptors are as the detector returns them (`detectors.Found`).
    """
    found = detect(reduced_grey(image, math.inf), kind, MOST_FEATURES, CONTRAST)
    points = ((found.points + 0.5) * reduction - 0.5).astype(np.float32)
    height, width = image.shape[0] * reduction, image.shape[1] * reduction
    return Features(points, found.descriptors, width, height, float(reduction))


def region_features(picture: ImageBGR, coverage: Coverage, kind: FeatureKind) -> Found:
    """Features of a part of the mosaic (h, w, 3) where covered (`coverage` (h, w), 0 or 255), in its pixels."""
    grey = _grey(picture)
    parts = [
        _block_features(grey, columns, rows, kind) for rows in _spans(len(grey)) for columns in _spans(grey.shape[1])
    ]
    points = np.concatenate([part.points for part in parts])
    x, y = np.rint(points).astype(int).T
    shown = coverage[y.clip(0, len(grey) - 1), x.clip(0, grey.shape[1] - 1)] > 0
    return Found(points[shown], np.concatenate([part.descriptors for part in parts])[shown])


def _spans(side: int) -> list[Span]:
    """Start and end of the blocks along a side; the last one may be half shorter or half longer than the others."""
    starts = range(0, max(side - BLOCK // 2, 1), BLOCK)
    return list(zip(starts, [*starts[1:], side], strict=True))


def _block_features(grey: ImageGrey, columns: Span, rows: Span, kind: FeatureKind) -> Found:
    """Features of a block, described with its surroundings in view."""
    left, top = max(0, columns[0] - MARGIN), max(0, rows[0] - MARGIN)
    found = detect(grey[top : rows[1] + MARGIN, left : columns[1] + MARGIN], kind, MOST_FEATURES, CONTRAST)
    points = np.add(found.points, [left, top])
    first, end = np.array([columns[0], rows[0]]) - 0.5, np.array([columns[1], rows[1]]) - 0.5
    own = ((points >= first) & (points < end)).all(axis=1)
    return Found(points[own], found.descriptors[own])


def _grey(image: ImageBGR) -> ImageGrey:
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), dtype=np.uint8)
