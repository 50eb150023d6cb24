"""What stands still in the picture while the ground moves: the pattern of a sensor, dirt on the lens.

A faint picture may show more of it than of the ground, and it matches itself at zero motion. Its mean over many frames is
taken away before features are sought, and only for that. Frames are counted only if they look different from the one
counted before: over an aircraft that hovers the mean would be the ground.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.stitch.features.extraction import Features, FeatureSettings, faint_features, joined
from gcs_mosaic.stitch.features.faint import PER_DEVIATION, Faint, blurred_faint
from gcs_mosaic.stitch.transaction import Kept

Floats = NDArray[np.float32]
Kind = tuple[int, int]  # width and height of a frame: each size is one camera

LEAST_FRAMES = 6  # different ones of which the mean is believed: a sixth of the ground of each is left in it
MEMORY = 64  # frames; sensors drift, and are calibrated anew during a flight
# Deviations beyond which a pixel counts no more: a bright roof in one frame must not leave a ghost in all that follow.
MOST_OF_A_PIXEL = 2.0
# Correlation of two frames above which their ground is taken for the same: over cold fields 0.6 and less between nine of ten
# consecutive frames, 0.97 where the aircraft stood still; 0.95 when hovering over ground a third as strong as the noise.
SAME_GROUND = 0.85
STILL_PX = (
    4.0  # px of the feature picture by which a match must have moved at least to be of other ground than the pattern
)
MOST_PATTERN = 0.25  # of a picture's energy; the mean of six different grounds alone takes a sixth


class StillPattern(Kept):
    """The mean of many faint pictures, for each size of frames."""

    def __init__(self) -> None:
        self._patterns: dict[Kind, Floats] = {}
        self._counts: dict[Kind, int] = {}
        self._last: dict[Kind, Floats] = {}  # blurred faint picture of the frame counted last

    def without(self, features: Features, settings: FeatureSettings) -> Features:
        """The features of a frame, sought anew where what stands still is known; learns from the frame. Once per frame."""
        if features.faint is None:
            return features
        kind = features.width, features.height
        self._learn(kind, features.faint)
        if self._counts[kind] < LEAST_FRAMES:
            return features  # its matches are told apart from the pattern's by `moving`
        freed = _freed(features.faint, self._patterns[kind])
        found = faint_features(freed, features, settings)
        if _energy(freed) < (1 - MOST_PATTERN) * _energy(features.faint):
            return found  # what was found in the picture as it is may be of the pattern
        return joined(_ordinary(features), found)

    def _learn(self, kind: Kind, faint: Faint) -> None:
        blurred = blurred_faint(faint)
        last = self._last.get(kind)
        if last is not None and _correlation(blurred, last) > SAME_GROUND:
            return
        bound = MOST_OF_A_PIXEL * PER_DEVIATION
        clipped = np.clip(faint.astype(np.float32), -bound, bound)
        count = self._counts.get(kind, 0)
        pattern = self._patterns.get(kind, clipped)
        self._patterns = self._patterns | {kind: pattern + (clipped - pattern) * np.float32(1 / min(count + 1, MEMORY))}
        self._counts = self._counts | {kind: count + 1}
        self._last = self._last | {kind: blurred}


def moving(a: Features, b: Features, matches: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Which matches (k, 2) may be of the ground: all, unless what stands still is still in both frames and they show different
    ground. Then what has not moved is the pattern."""
    if a.faint is None or b.faint is None or a.faint.shape != b.faint.shape:
        return np.ones(len(matches), bool)
    if _correlation(blurred_faint(a.faint), blurred_faint(b.faint)) > SAME_GROUND:
        return np.ones(len(matches), bool)
    apart = np.linalg.norm(a.points[matches[:, 0]] / a.scale - b.points[matches[:, 1]] / b.scale, axis=1)
    return np.asarray(apart > STILL_PX)


def _freed(faint: Faint, pattern: Floats) -> Floats:
    """A faint picture without as much of the pattern as it shows: automatic gain changes that from frame to frame."""
    levels = faint.astype(np.float32)
    share = float((levels * pattern).sum() / max(float((pattern * pattern).sum()), 1e-9))
    return np.asarray(levels - np.float32(max(share, 0.0)) * pattern, dtype=np.float32)


def _ordinary(features: Features) -> Features:
    """What was found in the picture as it is."""
    first = slice(features.ordinary)
    return replace(
        features, points=features.points[first], descriptors=features.descriptors[first], faint=None, ordinary=0
    )


def _energy(levels: NDArray[Any]) -> float:
    return float(np.square(levels.astype(np.float32)).sum())


def _correlation(a: Floats, b: Floats) -> float:
    return float((a * b).sum() / max(float(np.sqrt((a * a).sum() * (b * b).sum())), 1e-9))
