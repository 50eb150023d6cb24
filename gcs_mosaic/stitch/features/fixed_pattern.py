"""Fixed pattern: what stands still in the image while the ground moves (sensor pattern, dirt on the lens).

A faint image may show more of it than of the ground, and it matches itself at zero motion. Its mean over many frames is
subtracted before feature detection, and for nothing else. A frame is averaged only if it differs from the last one averaged:
over a hovering aircraft the mean would be the ground. A flight has a running mean; an archive, of which all frames are known,
makes its own of the same parts (`archive.fixed_patterns`).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gcs_mosaic.stitch.arrays import Band, FaintImage, FloatImage, IndexPairsNx2, Mask
from gcs_mosaic.stitch.features.extraction import Features, FeatureSettings, faint_features, joined
from gcs_mosaic.stitch.features.faint import PER_DEVIATION, blurred_faint
from gcs_mosaic.stitch.transaction import Kept, Numbers, Snapshot

Kind = tuple[int, int, int | None]  # width and height of a frame, and what carried the camera: each is one camera

LEAST_FRAMES = 6  # different frames before the mean is used: a sixth of each one's ground is left in it
MEMORY = 64  # frames; sensors drift and recalibrate during a flight
# Deviations at which a pixel is clipped: a bright roof in one frame must not leave a ghost in all later ones.
MOST_OF_A_PIXEL = 2.0
# Correlation of two frames above which they count as the same ground: over cold fields 0.6 and less in nine of ten consecutive
# frames, 0.97 when hovering; 0.95 when hovering over ground a third as strong as the noise.
SAME_GROUND = 0.85
STILL_PX = 4.0  # px of the feature picture; least motion of a match that is ground and not the pattern
MOST_PATTERN = 0.25  # of an image's energy; the mean of six different grounds alone has a sixth
_PICTURES = ("_patterns", "_last")


class StillPattern(Kept):
    """The mean of many faint pictures, for each camera."""

    def __init__(self) -> None:
        self._patterns: dict[Kind, FloatImage] = {}
        self._counts: dict[Kind, int] = {}
        self._last: dict[Kind, FloatImage] = {}  # blurred faint picture of the frame counted last

    def saved(self) -> Snapshot:
        """Pictures that are others after the next frame: a file of values to which they were appended would grow with each."""
        numbers = {name: {kind: Numbers.of(one) for kind, one in getattr(self, name).items()} for name in _PICTURES}
        return super().saved() | numbers

    def load(self, saved: Snapshot) -> None:
        pictures = {name: {kind: one.array() for kind, one in saved[name].items()} for name in _PICTURES}
        super().load(saved | pictures)

    def without(self, features: Features, settings: FeatureSettings, aircraft: int | None = None) -> Features:
        """A frame's features, detected again without the fixed pattern once that is known; learns from the frame. Once per
        frame."""
        faint = features.faint
        if faint is None:
            return features
        kind = features.width, features.height, aircraft
        self._learn(kind, faint)
        if self._counts[kind] < LEAST_FRAMES:
            return features  # `moving` separates its matches from the pattern's
        return freed(features, self._patterns[kind], settings)

    def _learn(self, kind: Kind, faint: FaintImage) -> None:
        blurred = blurred_faint(faint)
        last = self._last.get(kind)
        if last is not None and same_ground(blurred, last):
            return
        levels = clipped(faint)
        count = self._counts.get(kind, 0)
        pattern = self._patterns.get(kind, levels)
        self._patterns = self._patterns | {kind: pattern + (levels - pattern) * np.float32(1 / min(count + 1, MEMORY))}
        self._counts = self._counts | {kind: count + 1}
        self._last = self._last | {kind: blurred}


def same_ground(a: FloatImage, b: FloatImage) -> bool:
    """Whether two blurred faint pictures show the same ground, such as those of a hovering aircraft."""
    return _correlation(a, b) > SAME_GROUND


def clipped(faint: FaintImage) -> FloatImage:
    """A faint picture as it is averaged; its values are whole numbers."""
    bound = MOST_OF_A_PIXEL * PER_DEVIATION
    return np.clip(faint.astype(np.float32), -bound, bound)


def freed(features: Features, pattern: FloatImage, settings: FeatureSettings) -> Features:
    """A frame's features, detected again without this fixed pattern; the same features if its picture is not faint."""
    faint = features.faint
    if faint is None:
        return features
    levels = picture_without(faint, pattern)
    found = faint_features(levels, features, settings)
    if _energy(levels) < (1 - MOST_PATTERN) * _energy(faint):
        return found  # features of the unfiltered image may belong to the pattern
    return joined(_ordinary(features), found)


def moving(a: Features, b: Features, matches: IndexPairsNx2) -> Mask:
    """Which matches (k, 2) may be ground: all, unless the fixed pattern is still in both frames and they show different ground.
    Then matches that have not moved are the pattern."""
    faint_a, faint_b = a.faint, b.faint
    if faint_a is None or faint_b is None or faint_a.shape != faint_b.shape:
        return np.ones(len(matches), bool)
    if same_ground(blurred_faint(faint_a), blurred_faint(faint_b)):
        return np.ones(len(matches), bool)
    apart = np.linalg.norm(a.points[matches[:, 0]] / a.scale - b.points[matches[:, 1]] / b.scale, axis=1)
    return np.asarray(apart > STILL_PX)


def picture_without(faint: FaintImage, pattern: FloatImage) -> FloatImage:
    """A faint picture minus its projection onto the pattern, whose strength automatic gain changes from frame to frame."""
    levels = faint.astype(np.float32)
    share = float((levels * pattern).sum() / max(float((pattern * pattern).sum()), 1e-9))
    return np.asarray(levels - np.float32(max(share, 0.0)) * pattern, dtype=np.float32)


def _ordinary(features: Features) -> Features:
    """The features found in the image as it is."""
    first = slice(features.ordinary)
    points, descriptors = features.points[first], features.descriptors[first]
    return replace(features, kept_points=points, kept_descriptors=descriptors, kept_faint=None, ordinary=0)


def _energy(levels: Band) -> float:
    return float(np.square(levels.astype(np.float32)).sum())


def _correlation(a: FloatImage, b: FloatImage) -> float:
    return float((a * b).sum() / max(float(np.sqrt((a * a).sum() * (b * b).sum())), 1e-9))
